//! The pieces, as functions from arrays to arrays; documented in `softshadow/kernels.py`.

use pyo3::prelude::*;

mod layered;
mod single_sample;
mod ssoc;
pub(super) mod textures;
mod wedges;

/// Functions from arrays to arrays.
#[pymodule]
pub(super) mod kernels {
    use glam::DVec3;
    use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
    use pyo3::prelude::*;
    use rayon::prelude::*;

    use super::super::arrays;
    use super::super::camera::PyCamera;
    use super::super::light::PyLight;
    use super::super::run::{run, step};
    use super::super::scene::PyScene;
    use crate::bvh::packet::{Packet, Stack};
    use crate::error::{Error, Result};
    use crate::frame::Frame;
    use crate::geometry::entry::Material;
    use crate::light::unit;
    use crate::mesh::TriMesh;
    use crate::mesh::silhouettes::{SilhouetteEdge, loops, silhouette_edges as find_silhouettes};
    use crate::mesh::tubes::Curves;
    use crate::raster::nearest::{NONE, Nearest};
    use crate::raster::{rasterize as rasterize_into, tile_count};
    use crate::sampling::{LightSamples, Pattern, Sampler};
    use crate::scene::Scene;
    use crate::simd::LANES;

    #[pymodule_export]
    use super::layered::{layered_maps, trace_layered_maps};
    #[pymodule_export]
    use super::single_sample::{attenuation, outer_distances};
    #[pymodule_export]
    use super::ssoc::ssoc_maps;
    #[pymodule_export]
    use super::textures::{accumulate, convolve_shadow, receiver_transform};
    #[pymodule_export]
    use super::wedges::{light_intensity, wedges};

    type Ints2<'py> = Bound<'py, PyArray2<i32>>;
    type Ints1<'py> = Bound<'py, PyArray1<i32>>;
    type Floats2<'py> = Bound<'py, PyArray2<f32>>;
    type Floats1<'py> = Bound<'py, PyArray1<f32>>;
    type Longs2<'py> = Bound<'py, PyArray2<i64>>;
    type Doubles2<'py> = Bound<'py, PyArray2<f64>>;
    type Doubles1<'py> = Bound<'py, PyArray1<f64>>;

    fn mesh(
        py: Python<'_>,
        vertices: &PyReadonlyArray2<'_, f64>,
        faces: &PyReadonlyArray2<'_, i64>,
    ) -> PyResult<TriMesh> {
        let vertices = arrays::points(vertices, "vertices")?;
        let faces = arrays::faces(faces, "faces")?;
        step(py, || TriMesh::new("kernel", vertices, &faces))
    }

    fn finite(point: [f64; 3], what: &str) -> Result<DVec3> {
        let point = DVec3::from(point);
        if !point.is_finite() {
            let reason = format!("expected finite numbers, got {point}");
            return Err(Error::parameter(what, reason));
        }
        Ok(point)
    }

    #[pyfunction]
    fn mesh_edges<'py>(
        py: Python<'py>,
        vertices: PyReadonlyArray2<'py, f64>,
        faces: PyReadonlyArray2<'py, i64>,
    ) -> PyResult<(Ints2<'py>, Ints1<'py>)> {
        let mesh = mesh(py, &vertices, &faces)?;
        let (edges, counts) = step(py, || {
            let adjacency = mesh.adjacency();
            let edges: Vec<i32> = adjacency
                .edges()
                .iter()
                .flatten()
                .map(|&v| v as i32)
                .collect();
            let counts = (0..adjacency.edges().len())
                .map(|e| adjacency.incident(e).len() as i32)
                .collect();
            Ok((edges, counts))
        })?;
        Ok((arrays::rows(py, edges, 2)?, PyArray1::from_vec(py, counts)))
    }

    #[pyfunction]
    fn curve_tubes<'py>(
        py: Python<'py>,
        what: &str,
        points: PyReadonlyArray2<'py, f64>,
        offsets: PyReadonlyArray1<'py, i64>,
        radii: PyReadonlyArray1<'py, f64>,
        sides: i64,
    ) -> PyResult<(Doubles2<'py>, Longs2<'py>)> {
        let points = arrays::points(&points, what)?;
        let offsets = offsets.as_array().to_vec();
        let radii = arrays::values(&radii);
        let (vertices, faces) = step(py, || {
            let tubes = Curves::new(what, &points, &offsets, &radii, sides)?.tubes()?;
            let vertices = tubes.vertices.iter().flat_map(|v| v.to_array()).collect();
            Ok((vertices, tubes.faces.concat()))
        })?;
        Ok((arrays::rows(py, vertices, 3)?, arrays::rows(py, faces, 3)?))
    }

    #[pyfunction]
    fn silhouette_edges<'py>(
        py: Python<'py>,
        vertices: PyReadonlyArray2<'py, f64>,
        faces: PyReadonlyArray2<'py, i64>,
        viewpoint: [f64; 3],
    ) -> PyResult<(Ints2<'py>, Ints1<'py>)> {
        let mesh = mesh(py, &vertices, &faces)?;
        let viewpoint = finite(viewpoint, "viewpoint")?;
        let (edges, windings) = step(py, || {
            let found = silhouettes(&mesh, viewpoint);
            let edges = found.iter().flat_map(|s| ends(&mesh, s));
            let edges: Vec<i32> = edges.map(|v| v as i32).collect();
            let windings = found.iter().map(SilhouetteEdge::winding).collect();
            Ok((edges, windings))
        })?;
        Ok((
            arrays::rows(py, edges, 2)?,
            PyArray1::from_vec(py, windings),
        ))
    }

    #[pyfunction]
    fn silhouette_loops<'py>(
        py: Python<'py>,
        vertices: PyReadonlyArray2<'py, f64>,
        faces: PyReadonlyArray2<'py, i64>,
        viewpoint: [f64; 3],
    ) -> PyResult<Vec<Ints1<'py>>> {
        let mesh = mesh(py, &vertices, &faces)?;
        let viewpoint = finite(viewpoint, "viewpoint")?;
        let found = step(py, || {
            let edges: Vec<_> = silhouettes(&mesh, viewpoint)
                .iter()
                .map(|s| (ends(&mesh, s), [s.front, s.back]))
                .collect();
            Ok(loops(&edges, |v| mesh.vertices()[v as usize], viewpoint))
        })?;
        let array =
            |vertices: Vec<u32>| PyArray1::from_iter(py, vertices.into_iter().map(|v| v as i32));
        Ok(found.into_iter().map(|l| array(l.vertices)).collect())
    }

    fn silhouettes(mesh: &TriMesh, viewpoint: DVec3) -> Vec<SilhouetteEdge> {
        let position = |v: u32| mesh.vertices()[v as usize];
        find_silhouettes(position, mesh.faces(), mesh.adjacency(), viewpoint)
    }

    fn ends(mesh: &TriMesh, edge: &SilhouetteEdge) -> [u32; 2] {
        mesh.adjacency().edges()[edge.edge as usize]
    }

    #[pyfunction]
    #[pyo3(signature = (vertices, faces, camera, progress=None))]
    fn rasterize<'py>(
        py: Python<'py>,
        vertices: PyReadonlyArray2<'py, f64>,
        faces: PyReadonlyArray2<'py, i64>,
        camera: &PyCamera,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Ints2<'py>, Floats2<'py>)> {
        let vertices = arrays::points(&vertices, "vertices")?;
        let faces = arrays::faces(&faces, "faces")?;
        let world = camera.0;
        let (ids, depths) = run(py, progress.as_ref(), move |control| {
            let mut scene = Scene::default();
            let material = Material {
                albedo: [0.0; 3],
                opacity: 1.0,
                casts: true,
                receives: true,
            };
            scene.add_mesh("kernel", vertices, &faces, material)?;
            let geometry = scene.snapshot()?;
            let camera = world.to_local(&geometry.frame);
            control.expect(tile_count(&camera));
            let (positions, faces) = (&geometry.positions, &geometry.faces);
            let tiles = rasterize_into(positions, faces, |_| true, &camera, control, Nearest::new)?;
            let mut ids = vec![-1i32; camera.pixels()];
            let mut depths = vec![f32::INFINITY; camera.pixels()];
            for (tile, nearest) in tiles {
                for i in 0..nearest.triangle.len() as u32 {
                    let (x, y) = (tile.x + i % tile.width, tile.y + i / tile.width);
                    let to = (y * camera.width + x) as usize;
                    let triangle = nearest.triangle[i as usize];
                    if triangle != NONE {
                        ids[to] = triangle as i32;
                        let z = geometry.frame.unit / nearest.inverse_depth[i as usize];
                        depths[to] = z as f32;
                    }
                }
            }
            Ok((ids, depths))
        })?;
        let columns = world.width as usize;
        Ok((
            arrays::rows(py, ids, columns)?,
            arrays::rows(py, depths, columns)?,
        ))
    }

    #[pyfunction]
    #[pyo3(signature = (scene, origins, targets, progress=None))]
    fn transmittance<'py>(
        py: Python<'py>,
        scene: &PyScene,
        origins: PyReadonlyArray2<'py, f64>,
        targets: PyReadonlyArray2<'py, f64>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Floats1<'py>> {
        let origins = arrays::points(&origins, "origins")?;
        let targets = arrays::points(&targets, "targets")?;
        if origins.len() != targets.len() {
            let reason = format!(
                "expected {} as the origins, got {}",
                origins.len(),
                targets.len()
            );
            return Err(Error::parameter("targets", reason).into());
        }
        step(py, || {
            crate::mesh::check_finite("origins", "point", &origins)
        })?;
        step(py, || {
            crate::mesh::check_finite("targets", "point", &targets)
        })?;
        let scene = scene.shared();
        let out = run(py, progress.as_ref(), move |control| {
            let geometry = scene.snapshot_for_method(&[], "transmittance", true)?;
            let occluders = geometry.occluders();
            let chunks = origins
                .par_chunks(64 * LANES)
                .zip(targets.par_chunks(64 * LANES));
            control.expect(chunks.len());
            let parts: Vec<Vec<f32>> = chunks
                .map_init(
                    Default::default,
                    |(packet, stack): &mut (Packet, Stack), (o, t)| {
                        control.step()?;
                        let mut out = Vec::with_capacity(o.len());
                        for (o, t) in o.chunks(LANES).zip(t.chunks(LANES)) {
                            for (lane, (&o, &t)) in o.iter().zip(t).enumerate() {
                                let local = |p| geometry.frame.to_local(p).as_vec3();
                                packet.set(lane, local(o), local(t));
                            }
                            let active = u16::MAX >> (LANES - o.len());
                            let mut through = [0.0; LANES];
                            occluders.transmittance(packet, active, stack, &mut through);
                            out.extend_from_slice(&through[..o.len()]);
                        }
                        Ok(out)
                    },
                )
                .collect::<Result<_>>()?;
            Ok(parts.concat())
        })?;
        Ok(PyArray1::from_vec(py, out))
    }

    fn each_receiver<'py>(
        py: Python<'py>,
        points: &PyReadonlyArray2<'py, f64>,
        normals: Option<&PyReadonlyArray2<'py, f64>>,
        f: impl Fn(DVec3, DVec3) -> f64 + Sync,
    ) -> PyResult<Doubles1<'py>> {
        let points = arrays::points(points, "points")?;
        step(py, || crate::mesh::check_finite("points", "point", &points))?;
        let normals = match normals {
            None => vec![DVec3::ZERO; points.len()],
            Some(n) => arrays::points(n, "normals")?,
        };
        if normals.len() != points.len() {
            let reason = format!(
                "expected {} as the points, got {}",
                points.len(),
                normals.len()
            );
            return Err(Error::parameter("normals", reason).into());
        }
        step(py, || {
            crate::mesh::check_finite("normals", "normal", &normals)
        })?;
        let out: Vec<f64> = step(py, || {
            let pairs = points.par_iter().zip(&normals);
            Ok(pairs
                .map(|(&p, n)| f(p, unit(*n).unwrap_or_default()))
                .collect())
        })?;
        Ok(PyArray1::from_vec(py, out))
    }

    #[pyfunction]
    fn unshadowed_irradiance<'py>(
        py: Python<'py>,
        light: &PyLight,
        points: PyReadonlyArray2<'py, f64>,
        normals: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Doubles1<'py>> {
        let light = light.0.clone();
        each_receiver(py, &points, Some(&normals), |p, n| {
            light.unshadowed_irradiance(p, n)
        })
    }

    #[pyfunction]
    #[pyo3(signature = (light, points, normals=None))]
    fn light_fraction_above<'py>(
        py: Python<'py>,
        light: &PyLight,
        points: PyReadonlyArray2<'py, f64>,
        normals: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Doubles1<'py>> {
        let light = light.0.clone();
        each_receiver(py, &points, normals.as_ref(), |p, n| {
            light.fraction_above(p, n)
        })
    }

    #[pyfunction]
    fn light_samples<'py>(
        py: Python<'py>,
        light: &PyLight,
        point: [f64; 3],
        samples: i64,
        seed: u64,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Floats1<'py>, Floats2<'py>)> {
        let p = finite(point, "point")?;
        let most = crate::sampling::MOST_SAMPLES as i64;
        if !(1..=most).contains(&samples) {
            let reason = format!("must be 1 to {most}, got {samples}");
            return Err(Error::parameter("samples", reason).into());
        }
        // A frame around the light and the point, as a scene that holds both would have.
        let world = light.0.clone();
        let frame = if world.as_distant().is_some() {
            Frame::new(p, 1.0)
        } else {
            let (low, high) = world.bounds();
            let (low, high) = (low.min(p), high.max(p));
            let unit = (high - low).max_element().log2().ceil().exp2();
            Frame::new(0.5 * (low + high), if unit > 0.0 { unit } else { 1.0 })
        };
        let light = world.to_local(&frame);
        let n = samples as usize;
        let sampler = Sampler::new(light, Pattern::new(n, seed), true);
        let mut out = LightSamples::default();
        sampler.fill(0, frame.to_local(p), DVec3::ZERO, &mut out);
        let points: Vec<f64> = (0..n)
            .flat_map(|i| frame.to_world(out.point(i).as_dvec3()).to_array())
            .collect();
        let weights: Vec<f32> = (0..n)
            .map(|i| out.weights[i / LANES].0[i % LANES])
            .collect();
        let colours: Vec<f32> = (0..n).flat_map(|_| world.radiance).collect();
        let points = PyArray1::from_vec(py, points).reshape([n, 3])?;
        Ok((
            points,
            PyArray1::from_vec(py, weights),
            arrays::rows(py, colours, 3)?,
        ))
    }
}
