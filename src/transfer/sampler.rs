//! Fields anywhere between the points that carry them.

use rayon::prelude::*;

use super::{Carrier, Carry, TransferError, TransferField};
use crate::Point;
use crate::geometry::{Aabb, Bvh};
use crate::inverse::barycentric;

/// The fields of a carrier at any points: linear in tetrahedra, and the nearest point's value where there are none. Labels are
/// the value of the nearest corner, or that of the tetrahedron for fields over tetrahedra.
pub struct Sampler<'a> {
    carrier: &'a Carrier,
    by_tet: Bvh,
    tet_of_item: Vec<u32>,
    by_point: Bvh,
    point_of_item: Vec<u32>,
    /// A tetrahedron of each point, for fields over tetrahedra where no tetrahedron holds a point.
    tet_of_point: Vec<u32>,
}

/// Where a value comes from: carrier points with their weights, and a tetrahedron.
#[derive(Clone, Copy)]
struct Place {
    points: [u32; 4],
    weights: [f64; 4],
    tet: u32,
    held: bool,
}

const NONE: u32 = u32::MAX;
/// Barycentric coordinates that count as inside: no point may fall between tetrahedra.
const SLACK: f64 = 1e-9;

impl<'a> Sampler<'a> {
    /// Sorts the carrier's tetrahedra and points into trees.
    ///
    /// # Errors
    ///
    /// As [`Carrier::check`], and [`TransferError::Empty`].
    pub fn new(carrier: &'a Carrier) -> Result<Self, TransferError> {
        carrier.check()?;
        let is_finite = |p: &Point| p.iter().all(|c| c.is_finite());
        // Points in no tetrahedron carry nothing when there are tetrahedra.
        let mut tet_of_point = vec![NONE; carrier.points.len()];
        for (t, tet) in carrier.tets.iter().enumerate() {
            tet.iter().for_each(|&v| tet_of_point[v as usize] = t as u32);
        }
        let carries = |v: &u32| carrier.tets.is_empty() || tet_of_point[*v as usize] != NONE;
        let point_of_item: Vec<u32> = (0..carrier.points.len() as u32)
            .filter(|v| is_finite(&carrier.points[*v as usize]) && carries(v))
            .collect();
        if point_of_item.is_empty() {
            return Err(TransferError::Empty);
        }
        let corners = |t: u32| carrier.tets[t as usize].map(|v| carrier.points[v as usize]);
        let tet_of_item: Vec<u32> = (0..carrier.tets.len() as u32)
            .filter(|&t| corners(t).iter().all(is_finite))
            .collect();
        let boxes: Vec<Aabb> = tet_of_item.iter().map(|&t| Aabb::around(&corners(t))).collect();
        let points: Vec<Aabb> = point_of_item
            .iter()
            .map(|&v| Aabb::around(&[carrier.points[v as usize]]))
            .collect();
        Ok(Self {
            carrier,
            by_tet: Bvh::new(&boxes),
            tet_of_item,
            by_point: Bvh::new(&points),
            point_of_item,
            tet_of_point,
        })
    }

    /// The fields over points, then those over tetrahedra, at these points; NaN at points that are not finite. Also how many
    /// points lie in no tetrahedron, if there are tetrahedra.
    pub fn sample(&self, points: &[Point]) -> (Vec<TransferField>, usize) {
        let places: Vec<Option<Place>> = points.par_iter().map(|p| self.place(p)).collect();
        let beyond = places.iter().flatten().filter(|place| !place.held).count();
        let over_points = self
            .carrier
            .point_fields
            .iter()
            .map(|field| over_points(field, &places));
        let over_tets = self.carrier.cell_fields.iter().map(|field| over_tets(field, &places));
        (over_points.chain(over_tets).collect(), beyond)
    }

    fn place(&self, p: &Point) -> Option<Place> {
        if !p.iter().all(|c| c.is_finite()) {
            return None;
        }
        if let Some(place) = self.holding(p) {
            return Some(place);
        }
        let nearest = self.nearest(p);
        Some(Place {
            points: [nearest; 4],
            weights: [1.0, 0.0, 0.0, 0.0],
            tet: self.tet_of_point[nearest as usize],
            held: self.tet_of_item.is_empty(),
        })
    }

    /// The tetrahedron that holds a point; of several, the lowest.
    fn holding(&self, p: &Point) -> Option<Place> {
        let (all, mut at) = (self.by_tet.nodes(), 0);
        let mut best: Option<Place> = None;
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
                let points = self.carrier.tets[tet as usize];
                let weights = barycentric(&points.map(|v| self.carrier.points[v as usize]), p);
                let inside = weights.filter(|weights| weights.iter().all(|&w| w >= -SLACK));
                if let Some(weights) = inside.filter(|_| best.is_none_or(|best| tet < best.tet)) {
                    let held = true;
                    best = Some(Place {
                        points,
                        weights,
                        tet,
                        held,
                    });
                }
            }
        }
        best
    }

    fn nearest(&self, p: &Point) -> u32 {
        let mut best = (f64::INFINITY, NONE);
        self.by_point.visit_nearest(p, f64::INFINITY, |items, _| {
            for &item in &self.by_point.order()[items] {
                let point = self.point_of_item[item as usize];
                let candidate = ((self.carrier.points[point as usize] - p).norm_squared(), point);
                if candidate < best {
                    best = candidate;
                }
            }
            best.0
        });
        // Squares beyond the largest number leave none.
        if best.1 == NONE { self.point_of_item[0] } else { best.1 }
    }
}

fn over_points(field: &TransferField, places: &[Option<Place>]) -> TransferField {
    let value = |v: u32, k: usize| field.values[v as usize * field.components + k];
    let at = |place: &Place, k: usize| match field.carry {
        Carry::Label => {
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

fn over_tets(field: &TransferField, places: &[Option<Place>]) -> TransferField {
    with_values(field, places, |place, k| match place.tet {
        NONE => f64::NAN,
        tet => field.values[tet as usize * field.components + k],
    })
}

fn with_values(
    field: &TransferField,
    places: &[Option<Place>],
    at: impl Fn(&Place, usize) -> f64 + Sync,
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
