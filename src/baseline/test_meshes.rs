//! Regular tetrahedral meshes of any fineness.

use std::f64::consts::PI;

use crate::Point;
use crate::mesh::TetMesh;

/// The unit cube, six tetrahedra to each of `n³` cells (Kuhn's subdivision).
pub fn cube(n: usize) -> TetMesh {
    grid([n, n, n], false, |p| p)
}

/// The unit ball about the origin: each cube about it carried to a sphere, shell by shell.
pub fn ball(n: usize) -> TetMesh {
    grid([n, n, n], false, |p| {
        let q = p * 2.0 - nalgebra::Vector3::repeat(1.0);
        let (shell, length) = (q.coords.amax(), q.coords.norm());
        // Halfway between the cube's shape and the sphere's inside, so that no tetrahedron is flat.
        let to_sphere = if length > 0.0 { shell / length } else { 1.0 };
        let inner = 0.55;
        q * (inner + (to_sphere - inner) * shell * shell)
    })
}

/// A solid torus of a square cross-section of side 1 about the circle of radius 2.
pub fn torus(n: usize) -> TetMesh {
    grid([6 * n, n, n], true, |p| {
        let (angle, r) = (2.0 * PI * p.x, 1.5 + p.y);
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
    let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let mut tets = Vec::new();
    for i in 0..nx {
        for j in 0..ny {
            for k in 0..nz {
                for (number, order) in orders.iter().enumerate() {
                    let mut at = [i, j, k];
                    let mut tet = [vertex(i, j, k); 4];
                    for (corner, &axis) in order.iter().enumerate() {
                        at[axis] += 1;
                        tet[corner + 1] = vertex(at[0], at[1], at[2]);
                    }
                    if number >= 3 {
                        tet.swap(2, 3);
                    }
                    tets.push(tet);
                }
            }
        }
    }
    TetMesh::new(vertices, tets).expect("the grid names its own vertices")
}
