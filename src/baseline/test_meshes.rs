//! Regular tetrahedral meshes of any fineness.

use std::collections::HashMap;
use std::f64::consts::PI;

use crate::Point;
use crate::mesh::{KUHN, TetMesh};

/// The unit cube, six tetrahedra to each of `n³` cells (Kuhn's subdivision).
pub fn cube(n: usize) -> TetMesh {
    grid([n, n, n], false, |p| p)
}

/// The unit ball about the origin, `n³` tetrahedra to each octant: the octahedron carried to the sphere along its radii.
/// No tetrahedron has two sides on the boundary, and none gets flatter as `n` grows.
pub fn ball(n: usize) -> TetMesh {
    let mut index = HashMap::new();
    let (mut vertices, mut tets) = (Vec::new(), Vec::new());
    for octant in 0..8 {
        let signs = [0, 1, 2].map(|axis| if octant >> axis & 1 == 0 { 1 } else { -1 });
        let mirrored = signs.iter().product::<i32>() < 0;
        for mut tet in kuhn([n, n, n]) {
            // The part 1 ≥ x ≥ y ≥ z ≥ 0 of the cube is a tetrahedron, which is sheared into the octant.
            if tet.iter().any(|[x, y, z]| x < y || y < z) {
                continue;
            }
            if mirrored {
                tet.swap(2, 3);
            }
            tets.push(tet.map(|[x, y, z]| {
                let sheared = [x - y, y - z, z].map(|c| c as i32);
                let at = [0, 1, 2].map(|axis| signs[axis] * sheared[axis]);
                *index.entry(at).or_insert_with(|| {
                    let p = Point::from(at.map(|c| f64::from(c) / n as f64));
                    let (shell, length) = (p.coords.lp_norm(1), p.coords.norm());
                    vertices.push(if length > 0.0 { p * (shell / length) } else { p });
                    (vertices.len() - 1) as u32
                })
            }));
        }
    }
    TetMesh::new(vertices, tets).expect("the octants name their own vertices")
}

/// A solid torus of a square cross-section of side 1 about the circle of radius 2.
pub fn torus(n: usize) -> TetMesh {
    grid([6 * n, n, n], true, |p| {
        let (angle, r) = (-2.0 * PI * p.x, 1.5 + p.y);
        Point::new(r * angle.cos(), r * angle.sin(), p.z)
    })
}

/// A grid over the unit cube, carried by `place`; with `around` its last layer along x is its first.
fn grid([nx, ny, nz]: [usize; 3], around: bool, place: impl Fn(Point) -> Point) -> TetMesh {
    let layers = if around { nx } else { nx + 1 };
    let vertex = |i: usize, j: usize, k: usize| (((i % layers) * (ny + 1) + j) * (nz + 1) + k) as u32;
    let mut vertices = Vec::new();
    for i in 0..layers {
        for j in 0..=ny {
            for k in 0..=nz {
                let at = |i: usize, n: usize| i as f64 / n as f64;
                vertices.push(place(Point::new(at(i, nx), at(j, ny), at(k, nz))));
            }
        }
    }
    let tets = kuhn([nx, ny, nz])
        .map(|tet| tet.map(|[i, j, k]| vertex(i, j, k)))
        .collect();
    TetMesh::new(vertices, tets).expect("the grid names its own vertices")
}

/// The corners of six right-handed tetrahedra to each cell of a grid.
fn kuhn([nx, ny, nz]: [usize; 3]) -> impl Iterator<Item = [[usize; 3]; 4]> {
    let cells = (0..nx).flat_map(move |i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])));
    cells.flat_map(|cell| KUHN.map(|tet| tet.map(|corner| [0, 1, 2].map(|k| cell[k] + (corner >> k & 1)))))
}
