//! The part of a cell inside the solid, exact up to rounding.
//!
//! A point lies in the solid when more upward than downward triangles are above it. So the volume of a cell inside is
//! the signed sum, over the triangles above its square, of the prisms that they cut from it. Cells are divided from the
//! whole box down, and a cell needs only the triangles over its parent's square.

use crate::Point;
use crate::geometry::clip::{Polygon, between, fan, projected_area, split};
use crate::mesh::SurfaceMesh;

/// Cells whose fraction inside is this close to 1 are inside as a whole.
const NEGLIGIBLE: f64 = 1e-12;
/// Lengths below this, in units of the whole cube, count as rounding errors.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// The boundary of a solid, in units of the side of the cube around it.
pub(super) struct CellClipper {
    corners: Vec<[Point; 3]>,
}

/// How much of a cell is inside, and which triangles determine it.
#[derive(Default)]
pub(super) struct InsidePart {
    /// Volume inside, as a fraction of the cell.
    pub(super) fraction: f64,
    /// Triangles above or in the cell; none if it is inside or outside as a whole.
    pub(super) triangles: Vec<u32>,
}

impl CellClipper {
    /// Vertical triangles bound no volume from above and are left out.
    pub(super) fn new(surface: &SurfaceMesh, low: &Point, side: f64) -> Self {
        let scaled = |p: Point| Point::from((p - low) / side);
        let corners = (0..surface.triangles().len()).map(|t| surface.corners(t).map(scaled));
        Self {
            corners: corners.filter(|[a, b, c]| projected_area(a, b, c) != 0.0).collect(),
        }
    }

    pub(super) fn triangles(&self) -> Vec<u32> {
        (0..self.corners.len() as u32).collect()
    }

    /// The part inside of a cube, from the triangles of a cube that contains it.
    pub(super) fn inside_part(&self, low: &Point, side: f64, candidates: &[u32]) -> InsidePart {
        let (mut volume, mut triangles) = (0.0, Vec::new());
        // Sum of the absolute volumes, and whether the surface passes through the cell.
        let (mut absolute, mut is_crossed) = (0.0, false);
        for &t in candidates {
            let corners = &self.corners[t as usize];
            let over = |axis: usize, [a, b, c]: &[Point; 3]| {
                let (least, most) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
                (least < low[axis] + side && most > low[axis]).then_some(low[axis] <= least && most <= low[axis] + side)
            };
            let (Some(whole_x), Some(whole_y)) = (over(0, corners), over(1, corners)) else {
                continue;
            };
            if corners.iter().all(|p| p.z <= low.z) {
                continue;
            }
            let mut polygon = Polygon::from_slice(corners);
            for (axis, whole) in [(0, whole_x), (1, whole_y)] {
                if !whole {
                    polygon = between(polygon, axis, low[axis], low[axis] + side);
                }
            }
            if polygon.len() < 3 {
                continue;
            }
            triangles.push(t);
            let (_, above_floor) = split(polygon, 2, low.z);
            let (within, above) = split(above_floor, 2, low.z + side);
            is_crossed |= reaches_into(&within, low, side);
            let under = |[a, b, c]: [Point; 3]| projected_area(&a, &b, &c) * ((a.z + b.z + c.z) / 3.0 - low.z);
            let part = fan(&within).map(under).sum::<f64>()
                + fan(&above).map(|[a, b, c]| projected_area(&a, &b, &c)).sum::<f64>() * side;
            volume += part;
            absolute += part.abs();
        }
        let cell = side * side * side;
        let fraction = volume / cell;
        // Rounding errors of the side, and of the sum.
        let rounding = ROUNDING * (1.0 / side + absolute / cell);
        match fraction {
            _ if !is_crossed && fraction < rounding => InsidePart::default(),
            _ if fraction < rounding => InsidePart {
                fraction: fraction.max(0.0),
                triangles,
            },
            _ if (fraction - 1.0).abs() < NEGLIGIBLE => InsidePart::whole(),
            _ => InsidePart { fraction, triangles },
        }
    }
}

impl InsidePart {
    /// Whether the solid does not intersect the cell. A part inside may have a volume that rounds to 0.
    pub(super) fn is_empty(&self) -> bool {
        self.fraction == 0.0 && self.triangles.is_empty()
    }

    /// A cell that is inside as a whole.
    pub(super) fn whole() -> Self {
        Self {
            fraction: 1.0,
            triangles: Vec::new(),
        }
    }
}

/// Whether a polygon of the surface is inside a cell, and not only on its faces.
fn reaches_into(polygon: &Polygon, low: &Point, side: f64) -> bool {
    let ends = |axis: usize| {
        let along = polygon.iter().map(|p| p[axis] - low[axis]);
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)))
    };
    let is_wide = |axis: usize| {
        let (least, most) = ends(axis);
        most - least > ROUNDING
    };
    let (lowest, highest) = ends(2);
    is_wide(0) && is_wide(1) && highest > ROUNDING && lowest < side - ROUNDING
}
