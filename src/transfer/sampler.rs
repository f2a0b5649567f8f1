//! Fields anywhere between the points that carry them.

use rayon::prelude::*;

use super::{FieldKind, FieldMesh, TransferError, TransferField};
use crate::geometry::{Aabb, Bvh, closest_point_on_triangle};
use crate::inverse::barycentric;
use crate::{Point, Vector};

/// The fields of a mesh at any points: linear in tetrahedra, and beyond them as at the closest point of their
/// boundary. A mesh without tetrahedra has the values of the nearest point. Labels are those of the corner that has
/// the largest weight, or that of the tetrahedron for fields over tetrahedra.
pub struct FieldSampler<'a> {
    field_mesh: &'a FieldMesh,
    by_tet: Bvh,
    tet_of_item: Vec<u32>,
    by_rim: Bvh,
    rim: Vec<BoundaryFace>,
    /// Points no farther from the rim are not beyond it, as a square.
    margin_squared: f64,
}

/// A triangle that bounds the tetrahedra, with its tetrahedron; or a point, three times, where there are none.
struct BoundaryFace {
    corners: [u32; 3],
    tet: u32,
}

/// Where a value comes from: mesh points with their weights, and a tetrahedron.
#[derive(Clone, Copy)]
struct SampleLocation {
    points: [u32; 4],
    weights: [f64; 4],
    tet: u32,
    beyond: bool,
}

const NONE: u32 = u32::MAX;
/// Barycentric coordinates that count as inside: no point may fall between tetrahedra.
const SLACK: f64 = 1e-9;
/// What preimages of boundary points err by, as a fraction of the mesh's diagonal, and some more.
const MARGIN: f64 = 1e-6;

impl<'a> FieldSampler<'a> {
    /// Sorts the mesh's tetrahedra, and the triangles that bound them, into trees.
    ///
    /// # Errors
    ///
    /// As [`FieldMesh::check`], and [`TransferError::Empty`].
    pub fn new(field_mesh: &'a FieldMesh) -> Result<Self, TransferError> {
        field_mesh.check()?;
        let is_finite = |v: &u32| field_mesh.points[*v as usize].iter().all(|c| c.is_finite());
        let tet_of_item: Vec<u32> = (0..field_mesh.tets.len() as u32)
            .filter(|&t| field_mesh.tets[t as usize].iter().all(is_finite))
            .collect();
        let rim = if tet_of_item.is_empty() {
            let all = (0..field_mesh.points.len() as u32).filter(is_finite);
            all.map(|v| BoundaryFace {
                corners: [v; 3],
                tet: NONE,
            })
            .collect()
        } else {
            outer_triangles(&field_mesh.tets, &tet_of_item)
        };
        if rim.is_empty() {
            return Err(TransferError::Empty);
        }
        let point = |v: u32| field_mesh.points[v as usize];
        let around_tet = |&t: &u32| with_slack(Aabb::around(&field_mesh.tets[t as usize].map(point)));
        let boxes: Vec<Aabb> = tet_of_item.iter().map(around_tet).collect();
        let of_rim: Vec<Aabb> = rim.iter().map(|r| Aabb::around(&r.corners.map(point))).collect();
        let by_rim = Bvh::new(&of_rim);
        let diagonal = by_rim.nodes()[0].bounds.extent().norm();
        Ok(Self {
            field_mesh,
            by_tet: Bvh::new(&boxes),
            tet_of_item,
            by_rim,
            rim,
            margin_squared: (MARGIN * diagonal).powi(2),
        })
    }

    /// The fields over points, then those over tetrahedra, at these points; NaN at points that are not finite. Also which
    /// points lie beyond the tetrahedra, by more than a millionth of the mesh's diagonal; none without tetrahedra.
    pub fn sample(&self, points: &[Point]) -> (Vec<TransferField>, Vec<bool>) {
        let places: Vec<Option<SampleLocation>> = points.par_iter().map(|p| self.place(p)).collect();
        let beyond = places.iter().map(|place| place.is_some_and(|place| place.beyond));
        let over_points = self
            .field_mesh
            .point_fields
            .iter()
            .map(|field| over_points(field, &places));
        let over_tets = self
            .field_mesh
            .cell_fields
            .iter()
            .map(|field| over_tets(field, &places));
        (over_points.chain(over_tets).collect(), beyond.collect())
    }

    fn place(&self, p: &Point) -> Option<SampleLocation> {
        if !p.iter().all(|c| c.is_finite()) {
            return None;
        }
        Some(self.holding(p).unwrap_or_else(|| self.nearest(p)))
    }

    /// The tetrahedron that holds a point; of several, the lowest.
    fn holding(&self, p: &Point) -> Option<SampleLocation> {
        let (all, mut at) = (self.by_tet.nodes(), 0);
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
            for &item in &self.by_tet.order()[node.items()] {
                let tet = self.tet_of_item[item as usize];
                let points = self.field_mesh.tets[tet as usize];
                let weights = barycentric(&points.map(|v| self.field_mesh.points[v as usize]), p);
                let inside = weights.filter(|weights| weights.iter().all(|&w| w >= -SLACK));
                if let Some(weights) = inside.filter(|_| best.is_none_or(|best| tet < best.tet)) {
                    best = Some(SampleLocation {
                        points,
                        weights,
                        tet,
                        beyond: false,
                    });
                }
            }
        }
        best
    }

    /// The closest point of the rim; of several, that of the lowest triangle.
    fn nearest(&self, p: &Point) -> SampleLocation {
        // Squares beyond the largest number leave the first.
        let mut best = (f64::INFINITY, 0, [1.0, 0.0, 0.0]);
        self.by_rim.visit_nearest(p, f64::INFINITY, |items, _| {
            for &item in &self.by_rim.order()[items] {
                let corners = self.rim[item as usize]
                    .corners
                    .map(|v| self.field_mesh.points[v as usize]);
                let closest = closest_point_on_triangle(p, &corners);
                let distance = closest.offset.norm_squared();
                if (distance, item) < (best.0, best.1) {
                    best = (distance, item, closest.barycentric);
                }
            }
            best.0
        });
        let (distance, item, [a, b, c]) = best;
        let BoundaryFace { corners, tet } = self.rim[item as usize];
        SampleLocation {
            points: [corners[0], corners[1], corners[2], corners[0]],
            weights: [a, b, c, 0.0],
            tet,
            beyond: !self.tet_of_item.is_empty() && distance > self.margin_squared,
        }
    }
}

/// The triangles that belong to one of these tetrahedra only, in their order.
fn outer_triangles(tets: &[[u32; 4]], chosen: &[u32]) -> Vec<BoundaryFace> {
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
    let mut rim: Vec<BoundaryFace> = single
        .map(|same| BoundaryFace {
            corners: same[0].0,
            tet: same[0].1,
        })
        .collect();
    rim.sort_by_key(|triangle| triangle.tet);
    rim
}

/// The box of all points whose barycentric coordinates count as inside.
fn with_slack(bounds: Aabb) -> Aabb {
    let slack = Vector::repeat(4.0 * SLACK * bounds.extent().max());
    Aabb {
        low: bounds.low - slack,
        high: bounds.high + slack,
    }
}

fn over_points(field: &TransferField, places: &[Option<SampleLocation>]) -> TransferField {
    let value = |v: u32, k: usize| field.values[v as usize * field.components + k];
    let at = |place: &SampleLocation, k: usize| match field.kind {
        FieldKind::Label => {
            let largest = (0..4).max_by(|&a, &b| place.weights[a].total_cmp(&place.weights[b]).then(b.cmp(&a)));
            value(place.points[largest.unwrap_or(0)], k)
        }
        _ => (0..4)
            .map(|c| weighted(place.weights[c], value(place.points[c], k)))
            .sum(),
    };
    with_values(field, places, at)
}

/// What weighs nothing must not spoil a sum by being infinite.
fn weighted(weight: f64, value: f64) -> f64 {
    if weight == 0.0 { 0.0 } else { weight * value }
}

fn over_tets(field: &TransferField, places: &[Option<SampleLocation>]) -> TransferField {
    with_values(field, places, |place, k| match place.tet {
        NONE => f64::NAN,
        tet => field.values[tet as usize * field.components + k],
    })
}

fn with_values(
    field: &TransferField,
    places: &[Option<SampleLocation>],
    at: impl Fn(&SampleLocation, usize) -> f64 + Sync,
) -> TransferField {
    let mut values = vec![f64::NAN; places.len() * field.components];
    values
        .par_chunks_mut(field.components.max(1))
        .zip(places)
        .for_each(|(row, place)| {
            let Some(place) = place else { return };
            row.iter_mut().enumerate().for_each(|(k, value)| *value = at(place, k));
        });
    TransferField {
        values,
        ..field.clone()
    }
}
