//! Why cells stay inverted as long as the boundary nodes stay where they are.
//!
//! The tetrahedron at a corner of a cell is right-handed if its determinant is positive, and that is linear in each of
//! its nodes. Without inner nodes its sign is fixed by the boundary map. With one, that node has to lie on one side of
//! a plane. If the half-spaces of an inner node have no common point (its kernel is empty), a cell around it is
//! inverted wherever the other nodes are.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::bounded_mesh::{BoundedMesh, faces, sorted};
use super::quality::{HEX_CORNERS, at, invalid_cells, is_right_handed};
use super::rings::winding_rings;
use crate::mesh::CellList;
use crate::{Point, Vector};

/// Why a cell is inverted, as long as the boundary stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum InversionCause {
    /// The tetrahedron at a corner is inverted and has all its nodes on the boundary. Decided exactly.
    Boundary,
    /// An inner node has an empty kernel, so that this cell or another one at the node has to be inverted. Proved up to
    /// rounding.
    BlockedNode,
    /// It has a boundary quad with a corner that faces against its mean. No proof, but such cells are often inverted.
    FoldedQuad,
    /// It is at an inner edge about which the ring of boundary nodes around it winds by other than once. No proof, since the
    /// edge may move, but nodes one by one cannot get out of there.
    WindingRing,
    /// None of these is known.
    Unknown,
}

/// What prevents a mesh without inverted cells as long as the boundary stays.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub struct InversionCauses {
    /// Cells that [`InversionCause::Boundary`] holds for.
    pub boundary_cells: usize,
    /// Inner nodes with an empty kernel.
    pub blocked_nodes: usize,
    /// Boundary quads with a corner that faces against their mean.
    pub folded_quads: usize,
    /// Inner edges at inverted tetrahedra that [`InversionCause::WindingRing`] holds for, where the nodes are.
    pub winding_rings: usize,
    /// The cause for each cell; [`InversionCause::Unknown`] for most.
    #[serde(skip)]
    pub of_cells: Vec<InversionCause>,
}

/// Distance of a convex combination of planes from zero, in units of the node's neighbourhood, that counts as zero.
const ROUNDING: f64 = 1e-11;
/// Sine of the angle at a triangle's corner below which its plane is too inaccurate to prove anything.
const THIN: f64 = 1e-4;

/// Looks for causes of inversion with the mesh's nodes at `x`; positions of inner nodes matter for
/// [`InversionCause::WindingRing`] alone. Nodes missing in `x` prove nothing.
pub fn inversion_causes(mesh: &BoundedMesh, x: &[Point]) -> InversionCauses {
    let cells = mesh.cells.len();
    let mut found = InversionCauses {
        of_cells: vec![InversionCause::Unknown; cells],
        ..InversionCauses::default()
    };
    for quad in folded_quads(mesh, x) {
        found.folded_quads += 1;
        if let Some(cell) = quad {
            found.of_cells[cell as usize] = InversionCause::FoldedQuad;
        }
    }
    let rings = winding_rings(mesh, x, &invalid_cells(&mesh.cells, x).cells);
    found.winding_rings = rings.len();
    for cell in rings.into_iter().flat_map(|ring| ring.cells) {
        found.of_cells[cell as usize] = InversionCause::WindingRing;
    }
    let (mut planes, mut fixed) = (Vec::new(), Vec::new());
    for (cell, t) in corners(mesh) {
        match inner_nodes(mesh, t) {
            InnerNodes::None => fixed.push((cell, t)),
            InnerNodes::One(node, face) => planes.push((node, face, cell)),
            InnerNodes::More => {}
        }
    }
    planes.par_sort_unstable();
    let of_nodes: Vec<&[(u32, [u32; 3], u32)]> = planes.chunk_by(|a, b| a.0 == b.0).collect();
    let blocked: Vec<_> = of_nodes
        .into_par_iter()
        .filter(|planes| has_empty_kernel(planes.iter().map(|(_, face, _)| face.map(|v| at(x, v)))))
        .collect();
    found.blocked_nodes = blocked.len();
    for (_, _, cell) in blocked.into_iter().flatten() {
        found.of_cells[*cell as usize] = InversionCause::BlockedNode;
    }
    let mut last = None;
    for (cell, t) in fixed {
        if !is_right_handed(x, t) {
            found.boundary_cells += usize::from(last != Some(cell));
            last = Some(cell);
            found.of_cells[cell as usize] = InversionCause::Boundary;
        }
    }
    found
}

/// Cells and the tetrahedra at their corners.
fn corners(mesh: &BoundedMesh) -> Vec<(u32, [u32; 4])> {
    match &mesh.cells {
        CellList::Tets(tets) => (0..).zip(tets.iter().copied()).collect(),
        CellList::Hexes(hexes) => (0..)
            .zip(hexes)
            .flat_map(|(cell, h)| HEX_CORNERS.map(|c| (cell, c.map(|k| h[k]))))
            .collect(),
    }
}

/// The inner nodes of a tetrahedron.
enum InnerNodes {
    None,
    /// One, and the opposite face: the tetrahedron of the face and the node is to be right-handed.
    One(u32, [u32; 3]),
    More,
}

fn inner_nodes(mesh: &BoundedMesh, t: [u32; 4]) -> InnerNodes {
    // The faces of a right-handed tetrahedron, as seen from the opposite node.
    const OPPOSITE: [[usize; 3]; 4] = [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]];
    let mut inside = (0..4).filter(|&k| !mesh.on_boundary[t[k] as usize]);
    match (inside.next(), inside.next()) {
        (None, _) => InnerNodes::None,
        (Some(k), None) => InnerNodes::One(t[k], OPPOSITE[k].map(|i| t[i])),
        _ => InnerNodes::More,
    }
}

/// Whether no point is above all triangles, that is, `det(b - a, c - a, p - a) > 0` for every triangle `(a, b, c)`. By
/// Gordan's theorem there is none if and only if a convex combination of the planes is zero.
fn has_empty_kernel(triangles: impl Iterator<Item = [Point; 3]> + Clone) -> bool {
    let points: Vec<Point> = triangles.clone().flatten().collect();
    let mean = points.iter().map(|p| p.coords).sum::<Vector>() / points.len().max(1) as f64;
    let size = points.iter().map(|p| (p.coords - mean).norm()).fold(0.0, f64::max);
    // Written so that NaN returns as well.
    if !(size > 0.0 && size.is_finite()) {
        return false;
    }
    // Planes as (normal, offset), and the plane at infinity, which the point is not to lie in.
    let mut planes = vec![[0.0, 0.0, 0.0, 1.0]];
    for [a, b, c] in triangles {
        let edges = [b - a, c - a].map(|edge| edge.normalize());
        let normal = edges[0].cross(&edges[1]);
        let sine = normal.norm();
        if sine.is_nan() || sine < THIN {
            continue;
        }
        let normal = normal.normalize();
        let offset = normal.dot(&((a.coords - mean) / size));
        planes.push([normal.x, normal.y, normal.z, -offset]);
    }
    least_combination(&planes) < ROUNDING
}

/// Zero when the origin is in the convex hull of the vectors, otherwise `d / √(1 + d²)` for its distance `d`, by
/// non-negative least squares (Lawson & Hanson, *Solving Least Squares Problems*, 1974, chapter 23) for weights that
/// sum to 1 and combine the vectors to 0.
fn least_combination(vectors: &[[f64; 4]]) -> f64 {
    let count = vectors.len();
    let matrix = DMatrix::from_fn(5, count, |i, k| if i < 4 { vectors[k][i] } else { 1.0 });
    let right_hand_side = DVector::from_fn(5, |i, _| if i < 4 { 0.0 } else { 1.0 });
    let mut weights = DVector::zeros(count);
    let mut passive: Vec<usize> = Vec::new();
    let mut residual = right_hand_side.clone();
    // Every pass lowers the residual, so that no passive set occurs twice.
    for _ in 0..10 * count {
        let gradient = matrix.tr_mul(&residual);
        let best = (0..count)
            .filter(|k| !passive.contains(k))
            .max_by(|a, b| gradient[*a].total_cmp(&gradient[*b]));
        let Some(best) = best.filter(|&k| gradient[k] > 1e-14) else {
            break;
        };
        passive.push(best);
        while !passive.is_empty() {
            let columns = matrix.select_columns(&passive);
            let Ok(solution) = columns.svd(true, true).solve(&right_hand_side, 1e-13) else {
                return f64::INFINITY;
            };
            if solution.iter().all(|w| *w > 0.0) {
                weights.fill(0.0);
                passive.iter().zip(&solution).for_each(|(&k, w)| weights[k] = *w);
                break;
            }
            // Step back to where the first weight becomes zero.
            let step = passive
                .iter()
                .zip(&solution)
                .filter(|(_, w)| **w <= 0.0)
                .map(|(&k, w)| weights[k] / (weights[k] - w))
                .fold(1.0, f64::min);
            for (&k, w) in passive.iter().zip(&solution) {
                weights[k] += step * (w - weights[k]);
            }
            passive.retain(|&k| weights[k] > 1e-15);
        }
        let next = &right_hand_side - &matrix * &weights;
        if next.norm() >= residual.norm() {
            break;
        }
        residual = next;
    }
    residual.norm()
}

/// Boundary quads with a corner normal against their mean normal: the hexahedron of each, if it is known.
fn folded_quads(mesh: &BoundedMesh, x: &[Point]) -> Vec<Option<u32>> {
    let Some(quads) = mesh.quads() else {
        return vec![];
    };
    let is_folded = |quad: &[u32; 4]| {
        let p = quad.map(|v| at(x, v));
        let mean = (p[2] - p[0]).cross(&(p[3] - p[1]));
        let corner = |k: usize| (p[(k + 1) % 4] - p[k]).cross(&(p[(k + 3) % 4] - p[k]));
        !(0..4).all(|k| corner(k).dot(&mean) > 0.0)
    };
    let folded: Vec<[u32; 4]> = quads.into_iter().filter(is_folded).collect();
    if folded.is_empty() {
        return vec![];
    }
    let faces = faces(&mesh.cells);
    let owner = |quad: [u32; 4]| {
        let at = faces.binary_search_by(|face| face.nodes.cmp(&sorted(quad))).ok()?;
        Some(faces[at].cell)
    };
    folded.into_iter().map(owner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles in the planes of a cube's faces, facing inward.
    fn walls(low: f64, high: f64) -> Vec<[Point; 3]> {
        let mut walls = Vec::new();
        for axis in 0..3 {
            for (at, flip) in [(low, false), (high, true)] {
                let corner = |b: f64, c: f64| {
                    let mut p = Point::origin();
                    (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (at, b, c);
                    p
                };
                let [a, b, c] = [corner(-2.0, -2.0), corner(2.0, -2.0), corner(0.0, 2.0)];
                walls.push(if flip { [a, c, b] } else { [a, b, c] });
            }
        }
        walls
    }

    #[test]
    fn a_kernel_is_empty_only_if_no_point_is_above_all_planes() {
        for (low, high, blocked) in [
            (-1.0, 1.0, false),
            (0.1, 0.1 + 1e-6, false),
            (0.1, 0.1, true),
            (0.5, -0.5, true),
        ] {
            assert_eq!(has_empty_kernel(walls(low, high).into_iter()), blocked, "{low} {high}");
        }
        // Three walls at a corner, and a slanted one that moves towards it.
        let open = walls(-1.0, 1.0);
        let slanted = |offset: f64| {
            let normal = Vector::new(1.0, 1.0, 1.0).normalize();
            let (b, c) = (Vector::new(1.0, -1.0, 0.0), Vector::new(1.0, 1.0, -2.0));
            let at = Point::from(normal * offset);
            let det = b.cross(&c).dot(&normal);
            if det > 0.0 {
                [at, at + b, at + c]
            } else {
                [at, at + c, at + b]
            }
        };
        let corner = 3.0f64.sqrt();
        for (offset, blocked) in [(0.0, false), (corner - 1e-6, false), (corner + 1e-6, true)] {
            let planes = open.iter().copied().chain([slanted(offset)]);
            assert_eq!(has_empty_kernel(planes), blocked, "{offset}");
        }
        let flat = [Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(2.0, 0.0, 0.0)];
        assert!(!has_empty_kernel([flat].into_iter()), "proves nothing");
        let non_finite = [
            Point::origin(),
            Point::new(1.0, f64::NAN, 0.0),
            Point::new(0.0, 1.0, 0.0),
        ];
        assert!(!has_empty_kernel([non_finite].into_iter()));
    }
}
