//! The triangles of one vertex: their energy as a function of its direction alone, and steps that lower it.

use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use smallvec::SmallVec;

use super::bent::{BentImage, middle, moved_middle, pieces_energy, straight_energy};
use super::inter_surface::{BARRIER, DomainTriangle, InverseEmbedding, Spring, VertexImage, jacobian_invariants};
use crate::boundary_map::line_search::lower_along;
use crate::spherical::{Curvature, det, positive_det};
use crate::{Matrix3, Point, Vector};

/// A triangle of a vertex, as kept from sweep to sweep.
pub(super) struct StarTriangle {
    triangle: DomainTriangle,
    /// Where it or the triangle before it bends: triangles of the target in which the middle of the side to the neighbour was found
    /// last, and that of the side opposite to the vertex. They affect the time of the next search, not its result.
    hints: [AtomicU32; 2],
}

/// A neighbour of the vertex.
struct RingCorner {
    direction: Vector,
    image: VertexImage,
    /// The triangle of the vertex, this neighbour and the next.
    triangle: DomainTriangle,
    /// Whether this triangle or the one before it bends, so that the middle of the side to the neighbour counts.
    has_middle: bool,
    /// Triangle of the target near the image of that middle.
    hint: u32,
    /// Image of the middle of the side opposite to the vertex, where the triangle bends.
    opposite: Point,
}

/// The neighbours of a vertex in turn.
#[derive(Default)]
pub(super) struct VertexStar {
    corners: SmallVec<[RingCorner; 10]>,
    has_bent: bool,
}

impl StarTriangle {
    pub fn new(triangle: DomainTriangle) -> Self {
        Self {
            triangle,
            hints: [const { AtomicU32::new(u32::MAX) }; 2],
        }
    }
}

impl VertexStar {
    /// Replaces the neighbours by those of a vertex at `x`: their directions and images, and the triangles.
    pub fn fill<'a>(
        &mut self,
        inverse: &InverseEmbedding,
        x: &Vector,
        corners: impl Iterator<Item = ((Vector, VertexImage), &'a StarTriangle)> + Clone,
    ) {
        self.corners.clear();
        self.has_bent = corners.clone().any(|(_, kept)| kept.triangle.is_bent);
        self.corners
            .extend(corners.clone().map(|((direction, image), kept)| RingCorner {
                direction,
                image,
                triangle: kept.triangle,
                has_middle: false,
                hint: image.triangle,
                opposite: Point::origin(),
            }));
        if !self.has_bent {
            return;
        }
        let count = self.corners.len();
        for (i, (_, kept)) in corners.enumerate() {
            let next = self.corners[(i + 1) % count].direction;
            let is_after_bent = self.corners[(i + count - 1) % count].triangle.is_bent;
            let corner = &mut self.corners[i];
            let found = |a: &Vector, b: &Vector, hint: &AtomicU32| {
                let near = Some(hint.load(Relaxed)).filter(|&hint| hint != u32::MAX);
                let found = middle(inverse, a, b, near.unwrap_or(corner.image.triangle));
                hint.store(found.triangle, Relaxed);
                found
            };
            let [to_neighbour, opposite] = &kept.hints;
            if corner.triangle.is_bent || is_after_bent {
                let hint = found(x, &corner.direction, to_neighbour).triangle;
                (corner.has_middle, corner.hint) = (true, hint);
            }
            if corner.triangle.is_bent {
                corner.opposite = found(&corner.direction, &next, opposite).point;
            }
        }
    }

    /// Area of the triangles.
    pub fn area(&self) -> f64 {
        self.corners.iter().map(|corner| corner.triangle.rest.area).sum()
    }

    /// Energy of the triangles with the vertex at direction `x` and its image at `image`; `None` where it is not defined or
    /// a triangle on the sphere is not positive.
    pub fn value(
        &self,
        inverse: &InverseEmbedding,
        x: &Vector,
        image: &VertexImage,
        spring: Option<&Spring>,
    ) -> Option<f64> {
        let mut middles: SmallVec<[Point; 10]> = SmallVec::new();
        if self.has_bent {
            // Before the search for the middles, which costs more.
            for (a, b) in self.sides() {
                positive_det(x, &a.direction, &b.direction)?;
            }
            middles.extend(self.corners.iter().map(|corner| match corner.has_middle {
                true => middle(inverse, x, &corner.direction, corner.hint).point,
                false => Point::origin(),
            }));
        }
        let mut value = spring.map_or(0.0, |spring| spring.energy(x));
        for (i, (a, b)) in self.sides().enumerate() {
            let d = positive_det(x, &a.direction, &b.direction)?;
            let rest = &a.triangle.rest;
            let shape = rest.dirichlet(x, &a.direction, &b.direction) / (2.0 * d);
            let points = [&image.point, &a.image.point, &b.image.point];
            let energy = match a.triangle.is_bent {
                true => {
                    let next = &middles[(i + 1) % middles.len()];
                    pieces_energy(points, [&middles[i], &a.opposite, next], &a.triangle)
                }
                false => straight_energy(points, &a.triangle),
            };
            value += energy + rest.area * BARRIER * shape;
        }
        // NaN where the image has no area, as between two coincident sheets of the target.
        (!value.is_nan()).then_some(value)
    }

    /// A Newton step with line search from `x` that lowers the energy of the triangles; `None` if there is none.
    pub fn better_place(
        &self,
        inverse: &InverseEmbedding,
        x: &Vector,
        image: &VertexImage,
        spring: Option<&Spring>,
    ) -> Option<(Vector, VertexImage)> {
        let before = self.value(inverse, x, image, spring)?;
        let (gradient, hessian) = self.derivatives(inverse, x, image, spring);
        let step = Curvature::Spherical.newton_step(x, &gradient, &hessian)?;
        let slope = gradient.dot(&step).abs();
        lower_along(before, slope, |share| {
            let to = (x + share * step).normalize();
            let there = inverse.image(&to, image.triangle);
            Some((self.value(inverse, &to, &there, spring)?, (to, there)))
        })
    }

    /// First and second derivatives of the energy by the direction of the vertex.
    fn derivatives(
        &self,
        inverse: &InverseEmbedding,
        x: &Vector,
        image: &VertexImage,
        spring: Option<&Spring>,
    ) -> (Vector, Matrix3) {
        let y = image.point;
        let chain = inverse.derivative(x, image);
        let tangent = Matrix3::identity() - x * x.transpose();
        let moved_y = chain * tangent;
        let middles: SmallVec<[(Point, Matrix3); 10]> = match self.has_bent {
            true => {
                let of_corner = |corner: &RingCorner| match corner.has_middle {
                    true => moved_middle(inverse, x, &corner.direction, corner.hint, &tangent),
                    false => Default::default(),
                };
                self.corners.iter().map(of_corner).collect()
            }
            false => SmallVec::new(),
        };
        // Derivatives with respect to the image of the vertex, and to its direction.
        let (mut image_gradient, mut image_hessian) = (Vector::zeros(), Matrix3::zeros());
        let (mut gradient, mut hessian) = (Vector::zeros(), Matrix3::zeros());
        for (i, (a, b)) in self.sides().enumerate() {
            let DomainTriangle {
                rest,
                reference_area,
                is_bent,
            } = a.triangle;
            let [_, ca, cb] = rest.cotangents;
            let (p, q) = (a.image.point, b.image.point);
            if is_bent {
                let still = Matrix3::zeros();
                let sides = [middles[i], (a.opposite, still), middles[(i + 1) % middles.len()]];
                let bent = BentImage::new([&y, &p, &q], [moved_y, still, still], sides);
                let (of_bent, second) = bent.derivatives(&a.triangle);
                gradient += of_bent;
                hessian += second;
            } else {
                let (s, c, normal) = jacobian_invariants(&y, &p, &q, &a.triangle);
                let ds = (ca * (y - q) + cb * (y - p)) / reference_area;
                let dc = normal.cross(&(q - p)) / (2.0 * reference_area);
                let w = 0.25 * rest.area;
                let (c2, c3) = (c * c, c * c * c);
                image_gradient += w * ((1.0 + 1.0 / c2) * ds - 2.0 * s / c3 * dc);
                let cross = ds * dc.transpose();
                image_hessian += w
                    * (Matrix3::identity() * ((ca + cb) / reference_area * (1.0 + 1.0 / c2))
                        - (cross + cross.transpose()) * (2.0 / c3)
                        + dc * dc.transpose() * (6.0 * s / (c2 * c2)));
            }
            let d = det(x, &a.direction, &b.direction);
            let n = a.direction.cross(&(b.direction - a.direction));
            let q = rest.dirichlet(x, &a.direction, &b.direction);
            let dq = 2.0 * (ca * (x - b.direction) + cb * (x - a.direction));
            let w = 0.5 * BARRIER * rest.area;
            let cross = dq * n.transpose();
            gradient += w * (dq / d - q / (d * d) * n);
            hessian += w
                * (Matrix3::identity() * (2.0 * (ca + cb) / d) - (cross + cross.transpose()) / (d * d)
                    + n * n.transpose() * (2.0 * q / (d * d * d)));
        }
        gradient += chain.transpose() * image_gradient;
        hessian += chain.transpose() * image_hessian * chain;
        if let Some(spring) = spring {
            gradient += 2.0 * spring.weight * (x - spring.to);
            hessian += Matrix3::identity() * (2.0 * spring.weight);
        }
        (gradient, hessian)
    }

    /// Each neighbour with the next.
    fn sides(&self) -> impl Iterator<Item = (&RingCorner, &RingCorner)> {
        self.corners.iter().zip(self.corners.iter().cycle().skip(1))
    }
}
