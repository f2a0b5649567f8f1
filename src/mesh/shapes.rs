//! Procedural solids for demonstrations, tests and benchmarks: closed surfaces oriented outward.
//!
//! # Panics
//!
//! The functions here panic on sizes that make no solid (zero divisions); they are called with constants.

use std::collections::{HashMap, HashSet};

use rayon::prelude::*;

use super::SurfaceMesh;
use crate::{Point, Vector};

/// A sphere of `radius` about the origin: an icosahedron whose triangles are quartered `levels` times, then
/// projected. `10 · 4^levels + 2` vertices.
pub fn sphere(radius: f64, levels: u32) -> SurfaceMesh {
    let mut mesh = icosahedron();
    for _ in 0..levels {
        mesh = quartered(&mesh);
    }
    deformed(&mesh, |p| Point::from(p.coords.normalize() * radius))
}

/// A sphere of `radius` about the origin with almost any number of vertices: an icosahedron whose sides are cut into
/// `frequency` parts, then projected. `10 · frequency² + 2` vertices, each triangle's neighbours next to it in the
/// arrays.
pub fn geodesic_sphere(radius: f64, frequency: usize) -> SurfaceMesh {
    assert!(frequency > 0, "a geodesic sphere needs a frequency");
    let icosahedron = icosahedron();
    let mut vertices = icosahedron.vertices().to_vec();
    let mut triangles = Vec::with_capacity(20 * frequency * frequency);
    let mut first_on_side = HashMap::new();
    for &corners in icosahedron.triangles() {
        let between = |weights: [usize; 3]| {
            let weighted = (0..3).map(|k| icosahedron.vertices()[corners[k] as usize].coords * weights[k] as f64);
            Point::from(weighted.sum::<Vector>())
        };
        // Vertices of this face by row and place in the row; row `i` runs from side 0-1 to side 0-2.
        let mut lattice = vec![u32::MAX; (frequency + 1) * (frequency + 2) / 2];
        let at = |i: usize, j: usize| i * (i + 1) / 2 + j;
        for (k, (i, j)) in [(0, 0), (frequency, 0), (frequency, frequency)].into_iter().enumerate() {
            lattice[at(i, j)] = corners[k];
        }
        for k in 0..3 {
            let (start, end) = (corners[k], corners[(k + 1) % 3]);
            let forward = start < end;
            let first = *first_on_side
                .entry([start.min(end), start.max(end)])
                .or_insert_with(|| {
                    let first = vertices.len();
                    vertices.extend((1..frequency).map(|step| {
                        let mut weights = [0; 3];
                        let from_start = if forward { step } else { frequency - step };
                        (weights[k], weights[(k + 1) % 3]) = (frequency - from_start, from_start);
                        between(weights)
                    }));
                    first
                });
            for step in 1..frequency {
                let (i, j) = [(step, 0), (frequency, step), (frequency - step, frequency - step)][k];
                let along = if forward { step } else { frequency - step };
                lattice[at(i, j)] = (first + along - 1) as u32;
            }
        }
        for i in 2..frequency {
            for j in 1..i {
                lattice[at(i, j)] = vertices.len() as u32;
                vertices.push(between([frequency - i, i - j, j]));
            }
        }
        for i in 0..frequency {
            for j in 0..=i {
                triangles.push([(i, j), (i + 1, j), (i + 1, j + 1)].map(|(i, j)| lattice[at(i, j)]));
                if j < i {
                    triangles.push([(i, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| lattice[at(i, j)]));
                }
            }
        }
    }
    radially(built(vertices, triangles), |_| radius)
}

/// A test solid with almost any number of vertices: a ball of radius about 1 with bumps of several widths, from half of
/// it down to a thirtieth, on [`geodesic_sphere`]. Star-shaped about the origin, so that [`projected_to_sphere`] maps its
/// surface one to one. `10 · frequency² + 2` vertices.
pub fn bumpy_sphere(frequency: usize) -> SurfaceMesh {
    radially(geodesic_sphere(1.0, frequency), |direction| {
        let waves = BUMPS.iter().enumerate().map(|(k, &[height, wave_number])| {
            let turned = |axis: usize| wave_number * direction[(axis + k) % 3] + (k + axis) as f64;
            height * turned(0).sin() * (0.7 * turned(1) + 0.6 * turned(2)).cos()
        });
        1.0 + waves.sum::<f64>()
    })
}

/// Heights and wave numbers of the bumps: slopes of about a quarter each, so that the sum is no steeper than real
/// scans.
const BUMPS: [[f64; 2]; 5] = [[0.12, 2.0], [0.08, 4.0], [0.03, 9.0], [0.012, 20.0], [0.006, 45.0]];

/// Each vertex carried along its ray from the origin to the sphere of `radius`: the image of a star-shaped solid.
pub fn projected_to_sphere(mesh: &SurfaceMesh, radius: f64) -> SurfaceMesh {
    radially(mesh.clone(), |_| radius)
}

/// A torus about the z axis: `around` divisions of the circle of radius `major`, `across` of the tube of radius
/// `minor`. Genus 1.
pub fn torus(major: f64, minor: f64, around: usize, across: usize) -> SurfaceMesh {
    assert!(around >= 3 && across >= 3, "a torus needs three divisions each way");
    let turn = |k: usize, n: usize| 2.0 * std::f64::consts::PI * k as f64 / n as f64;
    let vertices = (0..around)
        .flat_map(|i| (0..across).map(move |j| (turn(i, around), turn(j, across))))
        .map(|(u, v)| {
            let r = major + minor * v.cos();
            Point::new(r * u.cos(), r * u.sin(), minor * v.sin())
        })
        .collect();
    let at = |i: usize, j: usize| ((i % around) * across + j % across) as u32;
    let triangles = (0..around)
        .flat_map(|i| (0..across).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    built(vertices, triangles)
}

/// The cube `[-size/2, size/2]³`, each side divided into `divisions` squares of two triangles.
pub fn cube(size: f64, divisions: usize) -> SurfaceMesh {
    let unit = polycube(&[[0, 0, 0]], divisions);
    deformed(&unit, |p| Point::from((p.coords - Vector::repeat(0.5)) * size))
}

/// The union of unit cubes at integer positions, each outer side divided into `divisions` squares of two triangles.
/// Cubes should share whole sides: where two touch in an edge or corner alone, the surface is not manifold.
pub fn polycube(cubes: &[[i32; 3]], divisions: usize) -> SurfaceMesh {
    assert!(
        divisions > 0 && !cubes.is_empty(),
        "a polycube needs cubes and divisions"
    );
    let n = divisions as i32;
    let mut filled = HashSet::new();
    let distinct: Vec<[i32; 3]> = cubes.iter().copied().filter(|&cube| filled.insert(cube)).collect();
    let mut index: HashMap<[i32; 3], u32> = HashMap::new();
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for cube in distinct {
        for axis in 0..3 {
            for side in [0, 1] {
                let mut neighbour = cube;
                neighbour[axis] += 2 * side - 1;
                if filled.contains(&neighbour) {
                    continue;
                }
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut lattice = |i: i32, j: i32| {
                    let mut key = cube.map(|c| c * n);
                    key[axis] += side * n;
                    key[u] += i;
                    key[v] += j;
                    *index.entry(key).or_insert_with(|| {
                        vertices.push(Point::from(key.map(|k| f64::from(k) / f64::from(n))));
                        (vertices.len() - 1) as u32
                    })
                };
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let [a, b, c, d] = [
                        lattice(i, j),
                        lattice(i + 1, j),
                        lattice(i + 1, j + 1),
                        lattice(i, j + 1),
                    ];
                    // Diagonals alternate, so that no direction is preferred.
                    let square = if (i + j) % 2 == 0 {
                        [[a, b, c], [a, c, d]]
                    } else {
                        [[a, b, d], [b, c, d]]
                    };
                    triangles.extend(square.map(|[p, q, r]| if side == 1 { [p, q, r] } else { [p, r, q] }));
                }
            }
        }
    }
    built(vertices, triangles)
}

/// A plate of 5 × 3 × 1 unit cubes with two square holes: genus 2.
pub fn double_torus(divisions: usize) -> SurfaceMesh {
    let cubes: Vec<[i32; 3]> = (0..5)
        .flat_map(|x| (0..3).map(move |y| [x, y, 0]))
        .filter(|&c| c != [1, 1, 0] && c != [3, 1, 0])
        .collect();
    polycube(&cubes, divisions)
}

/// A ball of radius `outer` with a concentric cavity of radius `inner`: two shells, the inner one oriented into the
/// cavity.
pub fn spherical_shell(outer: f64, inner: f64, levels: u32) -> SurfaceMesh {
    joined(&sphere(outer, levels), &sphere(inner, levels).reversed())
}

/// Both surfaces as one mesh; the vertices and triangles of `second` follow those of `first`.
pub fn joined(first: &SurfaceMesh, second: &SurfaceMesh) -> SurfaceMesh {
    let shift = first.vertices().len() as u32;
    let vertices = [first.vertices(), second.vertices()].concat();
    let moved = second.triangles().iter().map(|t| t.map(|v| v + shift));
    built(vertices, first.triangles().iter().copied().chain(moved).collect())
}

/// The same connectivity with every vertex moved by `f`: a boundary map given by a formula.
pub fn deformed(mesh: &SurfaceMesh, f: impl Fn(&Point) -> Point) -> SurfaceMesh {
    built(mesh.vertices().iter().map(f).collect(), mesh.triangles().to_vec())
}

/// Every triangle split into four at its edge midpoints. New vertices follow the old ones.
pub fn quartered(mesh: &SurfaceMesh) -> SurfaceMesh {
    let mut vertices = mesh.vertices().to_vec();
    let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            vertices.push(nalgebra::center(&vertices[a as usize], &vertices[b as usize]));
            (vertices.len() - 1) as u32
        })
    };
    let mut triangles = Vec::with_capacity(4 * mesh.triangles().len());
    for &[a, b, c] in mesh.triangles() {
        let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    built(vertices, triangles)
}

fn icosahedron() -> SurfaceMesh {
    let phi = (1.0 + 5f64.sqrt()) / 2.0;
    let vertices: Vec<Point> = [
        [-1., phi, 0.],
        [1., phi, 0.],
        [-1., -phi, 0.],
        [1., -phi, 0.],
        [0., -1., phi],
        [0., 1., phi],
        [0., -1., -phi],
        [0., 1., -phi],
        [phi, 0., -1.],
        [phi, 0., 1.],
        [-phi, 0., -1.],
        [-phi, 0., 1.],
    ]
    .iter()
    .map(|&p| Point::from(p))
    .collect();
    let triangles = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    built(vertices, triangles)
}

/// Each vertex at this distance from the origin, in its direction.
fn radially(mesh: SurfaceMesh, distance: impl Fn(&Vector) -> f64 + Sync) -> SurfaceMesh {
    let (mut vertices, triangles) = mesh.into_parts();
    vertices.par_iter_mut().for_each(|p| {
        let direction = p.coords.normalize();
        *p = Point::from(direction * distance(&direction));
    });
    built(vertices, triangles)
}

fn built(vertices: Vec<Point>, triangles: Vec<[u32; 3]>) -> SurfaceMesh {
    SurfaceMesh::new(vertices, triangles).expect("the shapes name their own vertices")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::topology::Topology;

    #[test]
    fn volumes_and_areas_are_those_of_the_solids() {
        let pi = std::f64::consts::PI;
        assert!((sphere(2.0, 5).volume() / (32.0 * pi / 3.0) - 1.0).abs() < 1e-3);
        assert!((torus(1.0, 0.3, 200, 100).volume() / (2.0 * pi * pi * 0.09) - 1.0).abs() < 2e-3);
        assert!((cube(2.0, 3).volume() - 8.0).abs() < 1e-12);
        assert!((cube(2.0, 3).area() - 24.0).abs() < 1e-12);
        assert!((double_torus(2).volume() - 13.0).abs() < 1e-12);
        assert!((spherical_shell(1.0, 0.5, 5).volume() / (7.0 * pi / 6.0) - 1.0).abs() < 1e-3);
    }

    /// Under a triangle of sides `h` the sphere's volume misses a fraction of `3h²/8`, and here `h < 1.4 / f`.
    #[test]
    fn geodesic_spheres_are_closed_and_of_any_frequency() {
        for frequency in [1, 2, 3, 7, 20] {
            let mesh = geodesic_sphere(2.0, frequency);
            assert_eq!(mesh.vertices().len(), 10 * frequency * frequency + 2);
            assert_eq!(mesh.triangles().len(), 20 * frequency * frequency);
            let topology = Topology::new(&mesh);
            assert!(topology.is_closed() && topology.is_edge_manifold());
            assert!(topology.orientation().inconsistent_edges.is_empty());
            assert_eq!(topology.components().shapes[0].genus(), Some(0));
            let missing = 1.0 - mesh.volume() / (32.0 * std::f64::consts::PI / 3.0);
            assert!(missing > 0.0 && missing < 0.75 / (frequency * frequency) as f64);
        }
    }

    #[test]
    fn a_bumpy_sphere_is_star_shaped_and_not_a_sphere() {
        let mesh = bumpy_sphere(60);
        for t in 0..mesh.triangles().len() {
            let [a, b, c] = mesh.corners(t).map(|p| p.coords);
            assert!(a.dot(&b.cross(&c)) > 0.0);
        }
        let distances = mesh.vertices().iter().map(|p| p.coords.norm());
        let (least, most) = distances.fold((f64::INFINITY, 0.0f64), |(l, m), d| (l.min(d), m.max(d)));
        assert!(least < 0.9 && most > 1.1 && least > 0.7 && most < 1.3);
        let image = projected_to_sphere(&mesh, 0.5);
        assert!(image.vertices().iter().all(|p| (p.coords.norm() - 0.5).abs() < 1e-15));
    }
}
