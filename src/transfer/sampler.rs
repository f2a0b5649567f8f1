//! Interpolation of fields.

use std::borrow::Cow;

use rayon::prelude::*;

use super::{FieldKind, FieldMesh, TransferError, TransferField};
use crate::geometry::{Aabb, Bvh, closest_point_on_triangle};
use crate::inverse::barycentric;
use crate::mesh::{CellList, tets_of_hex};
use crate::{Point, Vector};

/// Evaluates the fields of a mesh at any points: linear in tetrahedra, outside them as at the closest point of their
/// boundary. Hexahedra are cut into six tetrahedra each ([`tets_of_hex`]). Without cells, the values are those of the
/// nearest point. Labels are those of the corner with the largest weight, or of the cell for fields over cells.
pub struct FieldSampler<'a> {
    field_mesh: &'a FieldMesh,
    tets: Cow<'a, [[u32; 4]]>,
    /// Tetrahedra that a cell is cut into.
    tets_per_cell: u32,
    tet_tree: Bvh,
    tet_of_item: Vec<u32>,
    boundary_tree: Bvh,
    boundary: Vec<BoundaryFace>,
    /// Square of the distance from the boundary up to which a point does not count as outside.
    margin_squared: f64,
}

/// A boundary triangle of the tetrahedra, with its tetrahedron; without tetrahedra a point, three times.
struct BoundaryFace {
    corners: [u32; 3],
    tet: u32,
}

/// What a value is interpolated from: points of the mesh with their weights, and a tetrahedron.
#[derive(Clone, Copy)]
struct SampleLocation {
    points: [u32; 4],
    weights: [f64; 4],
    tet: u32,
    outside: bool,
}

const NONE: u32 = u32::MAX;
/// Negative barycentric coordinates up to this count as inside, so that no point falls between tetrahedra.
const SLACK: f64 = 1e-9;
/// Error of the preimages of boundary points, generously, as a fraction of the mesh's diagonal.
const MARGIN: f64 = 1e-6;

impl<'a> FieldSampler<'a> {
    /// Builds the trees over the tetrahedra and over their boundary.
    ///
    /// # Errors
    ///
    /// As [`FieldMesh::check`], and [`TransferError::Empty`].
    pub fn new(field_mesh: &'a FieldMesh) -> Result<Self, TransferError> {
        field_mesh.check()?;
        let is_finite = |v: &u32| field_mesh.points[*v as usize].iter().all(|c| c.is_finite());
        let (tets, tets_per_cell): (Cow<[[u32; 4]]>, u32) = match &field_mesh.cells {
            CellList::Tets(tets) => (tets.into(), 1),
            CellList::Hexes(hexes) => (hexes.iter().flat_map(tets_of_hex).collect(), 6),
        };
        let tet_of_item: Vec<u32> = (0..tets.len() as u32)
            .filter(|&t| tets[t as usize].iter().all(is_finite))
            .collect();
        let boundary = if tet_of_item.is_empty() {
            let all = (0..field_mesh.points.len() as u32).filter(is_finite);
            all.map(|v| BoundaryFace {
                corners: [v; 3],
                tet: NONE,
            })
            .collect()
        } else {
            boundary_faces(&tets, &tet_of_item)
        };
        if boundary.is_empty() {
            return Err(TransferError::Empty);
        }
        let point = |v: u32| field_mesh.points[v as usize];
        let around_tet = |&t: &u32| with_slack(Aabb::around(&tets[t as usize].map(point)));
        let boxes: Vec<Aabb> = tet_of_item.iter().map(around_tet).collect();
        let boundary_boxes: Vec<Aabb> = boundary
            .iter()
            .map(|face| Aabb::around(&face.corners.map(point)))
            .collect();
        let boundary_tree = Bvh::new(&boundary_boxes);
        let diagonal = boundary_tree.nodes()[0].bounds.extent().norm();
        Ok(Self {
            field_mesh,
            tets_per_cell,
            tet_tree: Bvh::new(&boxes),
            tet_of_item,
            boundary_tree,
            boundary,
            margin_squared: (MARGIN * diagonal).powi(2),
            tets,
        })
    }

    /// The fields over points, then those over cells, at these points; NaN at points that are not finite. Also which
    /// points lie outside the cells by more than a millionth of the mesh's diagonal; none without cells.
    pub fn sample(&self, points: &[Point]) -> (Vec<TransferField>, Vec<bool>) {
        let locations: Vec<Option<SampleLocation>> = points.par_iter().map(|p| self.locate(p)).collect();
        let is_outside = |location: &Option<SampleLocation>| location.is_some_and(|location| location.outside);
        let outside = locations.iter().map(is_outside).collect();
        let FieldMesh {
            point_fields,
            cell_fields,
            ..
        } = self.field_mesh;
        let over_points = point_fields.iter().map(|field| over_points(field, &locations));
        let over_cells = cell_fields
            .iter()
            .map(|field| over_cells(field, self.tets_per_cell, &locations));
        (over_points.chain(over_cells).collect(), outside)
    }

    fn locate(&self, p: &Point) -> Option<SampleLocation> {
        if !p.iter().all(|c| c.is_finite()) {
            return None;
        }
        Some(self.containing_tet(p).unwrap_or_else(|| self.nearest_on_boundary(p)))
    }

    /// The tetrahedron that contains a point; of several, the one with the lowest index.
    fn containing_tet(&self, p: &Point) -> Option<SampleLocation> {
        let (all, mut at) = (self.tet_tree.nodes(), 0);
        let mut best: Option<SampleLocation> = None;
        while at < all.len() {
            let node = &all[at];
            if !node.bounds.contains(p) {
                at += node.size();
                continue;
            }
            at += 1;
            if !node.is_leaf() {
                continue;
            }
            for &item in &self.tet_tree.order()[node.items()] {
                let tet = self.tet_of_item[item as usize];
                let points = self.tets[tet as usize];
                let weights = barycentric(&points.map(|v| self.field_mesh.points[v as usize]), p);
                let inside = weights.filter(|weights| weights.iter().all(|&w| w >= -SLACK));
                if let Some(weights) = inside.filter(|_| best.is_none_or(|best| tet < best.tet)) {
                    best = Some(SampleLocation {
                        points,
                        weights,
                        tet,
                        outside: false,
                    });
                }
            }
        }
        best
    }

    /// The closest point of the boundary; of several, that of the triangle with the lowest index.
    fn nearest_on_boundary(&self, p: &Point) -> SampleLocation {
        // The first triangle is kept where all squared distances overflow.
        let mut best = (f64::INFINITY, 0, [1.0, 0.0, 0.0]);
        self.boundary_tree.visit_nearest(p, f64::INFINITY, |items, _| {
            for &item in &self.boundary_tree.order()[items] {
                let corners = self.boundary[item as usize].corners;
                let corners = corners.map(|v| self.field_mesh.points[v as usize]);
                let closest = closest_point_on_triangle(p, &corners);
                let distance = closest.offset.norm_squared();
                if (distance, item) < (best.0, best.1) {
                    best = (distance, item, closest.barycentric);
                }
            }
            best.0
        });
        let (distance, item, [a, b, c]) = best;
        let BoundaryFace { corners, tet } = self.boundary[item as usize];
        SampleLocation {
            points: [corners[0], corners[1], corners[2], corners[0]],
            weights: [a, b, c, 0.0],
            tet,
            outside: !self.tet_of_item.is_empty() && distance > self.margin_squared,
        }
    }
}

/// The triangles that belong to only one of these tetrahedra, in the order of the tetrahedra.
fn boundary_faces(tets: &[[u32; 4]], chosen: &[u32]) -> Vec<BoundaryFace> {
    let faces = |&t: &u32| {
        let [a, b, c, d] = tets[t as usize];
        [[a, b, c], [a, b, d], [a, c, d], [b, c, d]].map(|mut corners| {
            corners.sort_unstable();
            (corners, t)
        })
    };
    let mut all: Vec<([u32; 3], u32)> = chosen.iter().flat_map(faces).collect();
    all.par_sort_unstable();
    let single = all.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() == 1);
    let mut boundary: Vec<BoundaryFace> = single
        .map(|same| BoundaryFace {
            corners: same[0].0,
            tet: same[0].1,
        })
        .collect();
    boundary.sort_by_key(|face| face.tet);
    boundary
}

/// The box with room for all points that count as inside.
fn with_slack(bounds: Aabb) -> Aabb {
    let slack = Vector::repeat(4.0 * SLACK * bounds.extent().max());
    Aabb {
        low: bounds.low - slack,
        high: bounds.high + slack,
    }
}

fn over_points(field: &TransferField, locations: &[Option<SampleLocation>]) -> TransferField {
    let value = |v: u32, k: usize| field.values[v as usize * field.components + k];
    let at = |location: &SampleLocation, k: usize| match field.kind {
        FieldKind::Label => {
            let largest = (0..4).max_by(|&a, &b| location.weights[a].total_cmp(&location.weights[b]).then(b.cmp(&a)));
            value(location.points[largest.unwrap_or(0)], k)
        }
        _ => (0..4)
            .map(|c| weighted(location.weights[c], value(location.points[c], k)))
            .sum(),
    };
    with_values(field, locations, at)
}

/// Zero for zero weights, also where the value is infinite.
fn weighted(weight: f64, value: f64) -> f64 {
    if weight == 0.0 { 0.0 } else { weight * value }
}

fn over_cells(field: &TransferField, tets_per_cell: u32, locations: &[Option<SampleLocation>]) -> TransferField {
    with_values(field, locations, |location, k| match location.tet {
        NONE => f64::NAN,
        tet => field.values[(tet / tets_per_cell) as usize * field.components + k],
    })
}

fn with_values(
    field: &TransferField,
    locations: &[Option<SampleLocation>],
    at: impl Fn(&SampleLocation, usize) -> f64 + Sync,
) -> TransferField {
    let mut values = vec![f64::NAN; locations.len() * field.components];
    let rows = values.par_chunks_mut(field.components.max(1));
    rows.zip(locations).for_each(|(row, location)| {
        let Some(location) = location else { return };
        for (k, value) in row.iter_mut().enumerate() {
            *value = at(location, k);
        }
    });
    TransferField {
        values,
        ..field.clone()
    }
}
