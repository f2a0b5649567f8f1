//! Closed surfaces of genus 0 that are hard to embed in the sphere.

use std::f64::consts::TAU;

use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::{Point, Vector};

/// All of them, by name.
pub fn shapes_of_genus_0() -> Vec<(&'static str, SurfaceMesh)> {
    vec![
        ("long spikes", spikes(12.0)),
        ("plate 1 : 1000", scaled(&shapes::cube(1.0, 12), [1.0, 1.0, 1e-3])),
        ("needles of aspect 10000", banded(5e-5)),
        ("hand with fingers", hand()),
        ("valence 200", lathe(&[[0.6, -0.7], [1.0, 0.0], [0.6, 0.7]], 200, 1.0)),
        ("scaled 1 : 100", scaled(&shapes::bumpy_sphere(16), [100.0, 1.0, 1.0])),
        ("needle 1 : 1000", scaled(&shapes::sphere(1.0, 3), [1.0, 1.0, 1000.0])),
        ("faces without area", with_flat_faces()),
        ("coincident vertices", with_coincident_vertices()),
        ("tetrahedron", tetrahedron()),
    ]
}

fn scaled(mesh: &SurfaceMesh, factors: [f64; 3]) -> SurfaceMesh {
    shapes::deformed(mesh, |p| {
        Point::new(p.x * factors[0], p.y * factors[1], p.z * factors[2])
    })
}

/// A ball with twelve spikes.
fn spikes(height: f64) -> SurfaceMesh {
    let tips: Vec<Vector> = shapes::sphere(1.0, 0).vertices().iter().map(|p| p.coords).collect();
    shapes::deformed(&shapes::sphere(1.0, 4), |p| {
        let nearest = tips
            .iter()
            .map(|tip| (p.coords - tip).norm())
            .fold(f64::INFINITY, f64::min);
        p * (1.0 + height * (-(nearest / 0.12).powi(2)).exp())
    })
}

/// Rings of `[radius, height]` about the z axis, closed by poles this far above the last and below the first.
fn lathe(rings: &[[f64; 2]], around: u32, cap: f64) -> SurfaceMesh {
    let last = rings.len() as u32 - 1;
    let mut vertices = vec![Point::new(0.0, 0.0, rings[0][1] - cap)];
    for [radius, height] in rings {
        vertices.extend((0..around).map(|j| {
            let angle = TAU * f64::from(j) / f64::from(around);
            Point::new(radius * angle.cos(), radius * angle.sin(), *height)
        }));
    }
    let tip = vertices.len() as u32;
    vertices.push(Point::new(0.0, 0.0, rings[last as usize][1] + cap));
    let at = |ring: u32, j: u32| 1 + ring * around + j % around;
    let mut triangles = Vec::new();
    for j in 0..around {
        triangles.push([0, at(0, j + 1), at(0, j)]);
        for ring in 0..last {
            let [a, b, c, d] = [at(ring, j), at(ring, j + 1), at(ring + 1, j + 1), at(ring + 1, j)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        triangles.push([at(last, j), at(last, j + 1), tip]);
    }
    SurfaceMesh::new(vertices, triangles).unwrap()
}

/// A cylinder whose rings stand in pairs this far apart.
fn banded(gap: f64) -> SurfaceMesh {
    let rings: Vec<[f64; 2]> = (0..10)
        .flat_map(|k| [[1.0, 0.2 * f64::from(k)], [1.0, 0.2 * f64::from(k) + gap]])
        .collect();
    lathe(&rings, 12, 0.2)
}

fn hand() -> SurfaceMesh {
    let palm = (0..5).flat_map(|x| (0..4).map(move |y| [x, y, 0]));
    let fingers = [0, 2, 4].into_iter().flat_map(|x| (4..10).map(move |y| [x, y, 0]));
    let thumb = (5..9).map(|x| [x, 1, 0]);
    shapes::polycube(&palm.chain(fingers).chain(thumb).collect::<Vec<_>>(), 3)
}

/// Every twentieth triangle has a corner at the midpoint of its opposite side, unless a later one moves that again.
fn with_flat_faces() -> SurfaceMesh {
    let mesh = shapes::sphere(1.0, 3);
    let mut vertices = mesh.vertices().to_vec();
    for [a, b, c] in mesh.triangles().iter().step_by(20) {
        vertices[*c as usize] = nalgebra::center(&vertices[*a as usize], &vertices[*b as usize]);
    }
    mesh.with_vertices(vertices).unwrap()
}

/// Every thirtieth triangle is a point, and so is the whole cap about the z axis.
fn with_coincident_vertices() -> SurfaceMesh {
    let mesh = shapes::sphere(1.0, 3);
    let mut vertices = mesh.vertices().to_vec();
    for [a, b, c] in mesh.triangles().iter().step_by(30) {
        vertices[*b as usize] = vertices[*a as usize];
        vertices[*c as usize] = vertices[*a as usize];
    }
    for p in vertices.iter_mut().filter(|p| p.z > 0.8) {
        *p = Point::new(0.0, 0.0, 0.8);
    }
    mesh.with_vertices(vertices).unwrap()
}

fn tetrahedron() -> SurfaceMesh {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    SurfaceMesh::new(corners.map(Point::from).to_vec(), triangles).unwrap()
}
