//! The scene as its user describes it: named meshes and spheres, with transforms apart.
//!
//! [`Scene::snapshot`] turns it into a [`Snapshot`], an immutable snapshot in local coordinates that
//! all methods work on. The snapshot is kept until something changes; where only vertices moved, the
//! bounding volume hierarchy keeps its topology.

pub mod around_lights;
mod kept;
pub mod snapshot;

use crate::geometry::entry::{Body, Entry, Material};
use crate::scene::kept::Kept;
use crate::scene::snapshot::Snapshot;
use std::collections::HashSet;
use std::sync::Arc;

use glam::{DAffine3, DVec3};

use crate::error::{Error, Result};
use crate::light::Light;
use crate::memory;
use crate::mesh::{TriMesh, check_finite};

/// Bytes that adding a mesh takes for a face and a vertex, and building what methods need of a scene (adjacency,
/// hierarchy, outlines). Measured on a million triangles: a process grows by 85 MB when they are added, and by 440 MB
/// at most while `ray_traced` is prepared.
const ADD_FACE: usize = 80;
const ADD_VERTEX: usize = 40;
const BUILD_FACE: usize = 460;
const BUILD_VERTEX: usize = 64;

/// Most repeated triangles (those of entries whose mesh another entry before them has) that are put in one list with all
/// others: what is built for them takes 2 GB.
pub const MOST_REPEATED: usize = 1 << 22;

/// When meshes that several entries share stay what they are, instances.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Instances {
    /// Where more than [`MOST_REPEATED`] triangles are repeated.
    #[default]
    Auto,
    /// Wherever a method takes them.
    Always,
    /// Nowhere: all triangles are put in one list, however many they are.
    Never,
}

/// Named entries and the snapshots built from them.
#[derive(Debug)]
pub struct Scene {
    entries: Vec<Entry>,
    instances: Instances,
    /// Snapshots with all triangles in one list.
    flat: Kept,
    /// Snapshots with placed meshes.
    placed: Kept,
}

impl Default for Scene {
    fn default() -> Self {
        Scene::new(Instances::default())
    }
}

impl Scene {
    /// An empty scene.
    pub fn new(instances: Instances) -> Self {
        Scene {
            entries: Vec::new(),
            instances,
            flat: Kept::new(false),
            placed: Kept::new(true),
        }
    }

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

    /// Adds a mesh that another entry has, which is then stored once; it is not moved.
    ///
    /// # Errors
    /// An unknown `shared` entry, a name that is taken, or an opacity outside 0 to 1.
    pub fn add_instance(&mut self, name: &str, shared: &str, material: Material) -> Result<()> {
        self.check_new(name, &format!("mesh {name:?}"), material)?;
        let mesh = self.mesh_mut(shared)?.0.clone();
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

    /// Returns the snapshot of the scene as it is now, with all triangles in one list.
    ///
    /// # Errors
    /// An empty scene, one too large for 32-bit indices, or more than [`MOST_REPEATED`] repeated triangles.
    pub fn snapshot(&mut self) -> Result<Arc<Snapshot>> {
        self.check_repeated()
            .map_err(|reason| Error::scene("scene", reason))?;
        self.flat.snapshot(&self.entries)
    }

    /// The snapshot of the entries ([`Scene::snapshot`]) in the frame that `lights` want.
    ///
    /// # Errors
    /// As of [`Scene::snapshot`], and a light that the scene is too large for.
    pub fn snapshot_for(&mut self, lights: &[Light]) -> Result<Arc<Snapshot>> {
        self.snapshot()?;
        self.flat.snapshot_for(&self.entries, lights)
    }

    /// The snapshot in the frame that `lights` want, for a method: with meshes placed, where the method takes them and the
    /// scene is to have them so.
    ///
    /// # Errors
    /// As of [`Scene::snapshot_for`]; [`Error::Unsupported`] for more repeated triangles than may be put in one list.
    pub fn snapshot_for_method(
        &mut self,
        lights: &[Light],
        method: &'static str,
        takes_instances: bool,
    ) -> Result<Arc<Snapshot>> {
        let placed = match self.instances {
            Instances::Auto => self.repeated() > MOST_REPEATED,
            Instances::Always => true,
            Instances::Never => false,
        };
        if placed && takes_instances {
            return self.placed.snapshot_for(&self.entries, lights);
        }
        self.check_repeated()
            .map_err(|reason| Error::Unsupported { method, reason })?;
        self.flat.snapshot_for(&self.entries, lights)
    }

    /// Triangles of entries whose mesh an entry before them has.
    fn repeated(&self) -> usize {
        let mut known = HashSet::new();
        let of = |mesh: &Arc<TriMesh>| match known.insert(Arc::as_ptr(mesh)) {
            true => 0,
            false => mesh.faces().len(),
        };
        self.meshes().map(of).sum()
    }

    fn meshes(&self) -> impl Iterator<Item = &Arc<TriMesh>> {
        self.entries.iter().filter_map(|e| match &e.shape {
            Body::Mesh(mesh, _) => Some(mesh),
            Body::Spheres(_) => None,
        })
    }

    /// Whether all triangles may be put in one list, or why not.
    fn check_repeated(&self) -> std::result::Result<(), String> {
        if self.instances == Instances::Never || self.repeated() <= MOST_REPEATED {
            return Ok(());
        }
        let triangles: usize = self.meshes().map(|m| m.faces().len()).sum();
        let gigabytes = bytes_to_build(self.meshes()) as f64 / 1e9;
        let (repeated, meshes) = (self.repeated(), self.meshes().count());
        Err(format!(
            "it needs the triangles of all {meshes} meshes in one list, {triangles}, which take {gigabytes:.1} GB; of these, \
             {repeated} are of meshes that are there already, and at most {MOST_REPEATED} of such are put there. \
             hard and ray_traced take instances as they are; Scene(instances=\"never\") lifts the limit"
        ))
    }

    fn push(&mut self, name: &str, shape: Body, material: Material) {
        self.entries.push(Entry {
            name: name.into(),
            shape,
            material,
        });
        self.changed();
    }

    /// Only positions: the topology of snapshots can be used again.
    fn moved(&mut self) {
        self.flat.moved();
        self.placed.moved();
    }

    /// Something else than positions: nothing of a flat snapshot can be used again; of the others the trees of meshes can.
    fn changed(&mut self) {
        self.flat = Kept::new(false);
        self.placed.moved();
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

/// Bytes that building what methods need of meshes takes, each as often as it is there.
fn bytes_to_build<'a>(meshes: impl Iterator<Item = &'a Arc<TriMesh>>) -> usize {
    let sizes = meshes.map(|m| (m.faces().len(), m.vertices().len()));
    sizes.map(|(f, v)| BUILD_FACE * f + BUILD_VERTEX * v).sum()
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
