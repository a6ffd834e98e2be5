//! The scene as its user describes it: named meshes and spheres, with transforms apart.
//!
//! [`Scene::snapshot`] turns it into a [`Snapshot`], an immutable snapshot in local coordinates that
//! all methods work on. The snapshot is kept until something changes; where only vertices moved, the
//! bounding volume hierarchy keeps its topology.

pub mod around_lights;
pub mod snapshot;

use crate::geometry::entry::{Body, Entry, Material};
use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use glam::{DAffine3, DVec3};

use crate::error::{Error, Result};
use crate::light::Light;
use crate::memory;
use crate::mesh::{TriMesh, check_finite};
use crate::scene::around_lights::for_lights;

/// Bytes that adding a mesh takes for a face and a vertex, and building what methods need of a scene (adjacency,
/// hierarchy, outlines). Measured on a million triangles: a process grows by 85 MB when they are added, and by 440 MB
/// at most while `ray_traced` is prepared.
const ADD_FACE: usize = 80;
const ADD_VERTEX: usize = 40;
const BUILD_FACE: usize = 460;
const BUILD_VERTEX: usize = 64;

/// Named entries and the snapshot built from them.
#[derive(Debug, Default)]
pub struct Scene {
    entries: Vec<Entry>,
    current: Option<Arc<Snapshot>>,
    /// A snapshot with the same entries, but for positions: its topology can be refitted.
    previous: Option<Arc<Snapshot>>,
    /// The last snapshot in the frame of lights.
    around_lights: Option<Arc<Snapshot>>,
}

impl Scene {
    /// The entries, in the order in which they were added.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Adds a mesh.
    ///
    /// # Errors
    /// What [`TriMesh::new`] finds, a name that is taken, or an opacity outside 0 to 1.
    pub fn add_mesh(
        &mut self,
        name: &str,
        vertices: Vec<DVec3>,
        faces: &[[i64; 3]],
        material: Material,
    ) -> Result<()> {
        let what = format!("mesh {name:?}");
        self.check_new(name, &what, material)?;
        let bytes = ADD_FACE * faces.len() + ADD_VERTEX * vertices.len();
        memory::check(|| format!("{what}: adding it"), bytes)?;
        let mesh = Arc::new(TriMesh::new(name, vertices, faces)?);
        self.push(name, Body::Mesh(mesh, DAffine3::IDENTITY), material);
        Ok(())
    }

    /// Adds spheres, given by world-space centres and radii.
    ///
    /// # Errors
    /// No spheres, a value that is not finite, a radius that is not positive, a name that is taken,
    /// or an opacity outside 0 to 1.
    pub fn add_spheres(
        &mut self,
        name: &str,
        centers: &[DVec3],
        radii: &[f64],
        material: Material,
    ) -> Result<()> {
        let what = format!("spheres {name:?}");
        self.check_new(name, &what, material)?;
        let spheres = checked_spheres(&what, centers, radii)?;
        self.push(name, Body::Spheres(spheres), material);
        Ok(())
    }

    /// Puts other spheres in the place of an entry's.
    ///
    /// # Errors
    /// An unknown name, or what [`Scene::add_spheres`] finds.
    pub fn set_spheres(&mut self, name: &str, centers: &[DVec3], radii: &[f64]) -> Result<()> {
        let entry = self.entry_mut(name)?;
        let Body::Spheres(spheres) = &mut entry.shape else {
            let what = format!("mesh {name:?}");
            return Err(Error::scene(what, "expected the name of spheres"));
        };
        *spheres = checked_spheres(&format!("spheres {name:?}"), centers, radii)?;
        self.changed();
        Ok(())
    }

    /// Changes how an entry looks and what it takes part in.
    ///
    /// # Errors
    /// An unknown name, or an opacity outside 0 to 1.
    pub fn set_material(&mut self, name: &str, material: Material) -> Result<()> {
        let entry = self.entry_mut(name)?;
        check_opacity(&format!("entry {name:?}"), material)?;
        let shadows = |m: &Material| (m.opacity.to_bits(), m.casts);
        let same = shadows(&entry.material) == shadows(&material);
        entry.material = material;
        // What only shades leaves the hierarchies as they are.
        if same {
            self.moved()
        } else {
            self.changed()
        }
        Ok(())
    }

    /// Takes an entry out.
    ///
    /// # Errors
    /// An unknown name.
    pub fn remove(&mut self, name: &str) -> Result<()> {
        self.entry_mut(name)?;
        self.entries.retain(|e| e.name != name);
        self.changed();
        Ok(())
    }

    /// Places a mesh.
    ///
    /// # Errors
    /// An unknown name, or a transform that is not finite or flattens the mesh.
    pub fn set_transform(&mut self, name: &str, matrix: DAffine3) -> Result<()> {
        let (_, transform) = self.mesh_mut(name)?;
        let what = format!("mesh {name:?}: transform");
        let determinant = matrix.matrix3.determinant();
        if !matrix.is_finite() {
            return Err(Error::scene(what, "expected finite numbers"));
        }
        // Compared with the product of the columns' lengths, so that no unit enters.
        let size: f64 = (0..3).map(|i| matrix.matrix3.col(i).length()).product();
        if determinant.abs() <= 1e-12 * size || size == 0.0 {
            return Err(Error::scene(
                what,
                format!("singular, determinant {determinant}"),
            ));
        }
        *transform = matrix;
        self.moved();
        Ok(())
    }

    /// Moves a mesh's vertices.
    ///
    /// # Errors
    /// An unknown name, or what [`TriMesh::with_vertices`] finds.
    pub fn set_vertices(&mut self, name: &str, vertices: Vec<DVec3>) -> Result<()> {
        let (mesh, _) = self.mesh_mut(name)?;
        *mesh = Arc::new(mesh.with_vertices(name, vertices)?);
        self.moved();
        Ok(())
    }

    /// Returns the snapshot of the scene as it is now.
    ///
    /// # Errors
    /// An empty scene, or one too large for 32-bit indices.
    pub fn snapshot(&mut self) -> Result<Arc<Snapshot>> {
        if self.current.is_none() {
            let sizes = self.entries.iter().filter_map(|e| match &e.shape {
                Body::Mesh(mesh, _) => Some([mesh.faces().len(), mesh.vertices().len()]),
                Body::Spheres(_) => None,
            });
            let bytes = sizes.map(|[f, v]| BUILD_FACE * f + BUILD_VERTEX * v).sum();
            memory::check(|| "scene: what is built for it".into(), bytes)?;
            let built = Snapshot::new(&self.entries, self.previous.as_deref(), None)?;
            self.previous = None;
            self.current = Some(Arc::new(built));
        }
        Ok(self.current.clone().expect("set above"))
    }

    /// The snapshot of the entries ([`Scene::snapshot`]) in the frame that `lights` want.
    ///
    /// # Errors
    /// As of [`Scene::snapshot`], and a light that the scene is too large for.
    pub fn snapshot_for(&mut self, lights: &[Light]) -> Result<Arc<Snapshot>> {
        let geometry = self.snapshot()?;
        let Some(frame) = for_lights(&geometry, lights)? else {
            return Ok(geometry);
        };
        let is_in =
            |g: &&Arc<Snapshot>| g.frame.origin == frame.origin && g.frame.unit == frame.unit;
        if let Some(known) = self.around_lights.as_ref().filter(is_in) {
            return Ok(known.clone());
        }
        let built = Snapshot::new(&self.entries, Some(&geometry), Some(frame))?;
        let built = Arc::new(built);
        // It may want a smaller frame still, but not one that is held.
        for_lights(&built, lights)?;
        self.around_lights = Some(built.clone());
        Ok(built)
    }

    fn moved(&mut self) {
        self.around_lights = None;
        if let Some(current) = self.current.take() {
            self.previous = Some(current);
        }
    }

    fn push(&mut self, name: &str, shape: Body, material: Material) {
        self.entries.push(Entry {
            name: name.into(),
            shape,
            material,
        });
        self.changed();
    }

    /// Something else than positions: nothing of the snapshot can be used again.
    fn changed(&mut self) {
        self.current = None;
        self.previous = None;
        self.around_lights = None;
    }

    fn entry_mut(&mut self, name: &str) -> Result<&mut Entry> {
        let found = self.entries.iter_mut().find(|e| e.name == name);
        found.ok_or_else(|| Error::scene("scene", format!("nothing named {name:?}")))
    }

    fn check_new(&self, name: &str, what: &str, material: Material) -> Result<()> {
        if self.entries.iter().any(|e| e.name == name) {
            return Err(Error::scene(
                what,
                "the scene has another entry of that name",
            ));
        }
        check_opacity(what, material)
    }

    fn mesh_mut(&mut self, name: &str) -> Result<(&mut Arc<TriMesh>, &mut DAffine3)> {
        let found = self.entries.iter_mut().find(|e| e.name == name);
        match found.map(|e| &mut e.shape) {
            Some(Body::Mesh(mesh, transform)) => Ok((mesh, transform)),
            Some(Body::Spheres(_)) => Err(Error::scene(
                format!("spheres {name:?}"),
                "expected the name of a mesh",
            )),
            None => Err(Error::scene("scene", format!("no mesh named {name:?}"))),
        }
    }
}

fn check_opacity(what: &str, material: Material) -> Result<()> {
    if (0.0..=1.0).contains(&material.opacity) {
        return Ok(());
    }
    let reason = format!("opacity must be between 0 and 1, got {}", material.opacity);
    Err(Error::scene(what, reason))
}

fn checked_spheres(what: &str, centers: &[DVec3], radii: &[f64]) -> Result<Arc<Vec<(DVec3, f64)>>> {
    if centers.is_empty() || centers.len() != radii.len() {
        let reason = format!(
            "expected one sphere or more, and one radius a center, got {} and {}",
            radii.len(),
            centers.len()
        );
        return Err(Error::scene(what, reason));
    }
    check_finite(what, "center", centers)?;
    if let Some(i) = radii.iter().position(|r| !(r.is_finite() && *r > 0.0)) {
        let reason = format!("radius {i} must be positive and finite, got {}", radii[i]);
        return Err(Error::scene(what, reason));
    }
    let spheres = centers.iter().copied().zip(radii.iter().copied());
    Ok(Arc::new(spheres.collect()))
}
