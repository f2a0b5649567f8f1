//! Sweeps: every vertex of a layout moved on its own to lower the energy of its triangles.

mod cut;
mod element;
mod hyperbolic;
mod sphere;
mod torus;

use rayon::prelude::*;

pub(crate) use cut::{Cut, secant};
pub(crate) use element::{Chain, Derivatives, add_image_derivatives, barrier, barrier_derivatives, image_energy};
pub(crate) use hyperbolic::HyperbolicTarget;
pub(crate) use sphere::{SphereLayout, SphereTarget};
pub(crate) use torus::TargetTorus;

use super::line_search::lower_along;
use crate::spherical::{Curvature, RestShape};
use crate::{Matrix3, Point, Vector};

/// A layout of a simplified mesh on the surface that a target is laid out on.
pub(crate) trait Layout: Sync {
    type Target: Sync;
    /// The target around a place, in a plane at height 1.
    type Around<'t>: TargetAround;

    fn inserted(&self) -> &[u32];
    /// The neighbours of a vertex, counter-clockwise.
    fn ring(&self, v: u32) -> impl ExactSizeIterator<Item = u32>;
    /// The factor that scales the area of the simplified mesh, with its vertices at `points`, to that of the surface laid out on.
    fn area_scale(&self, points: &[Point]) -> f64;
    /// The target around a vertex, the place of the vertex in the plane, and those of its ring; `None` where the ring is not in one
    /// plane.
    fn star<'t>(&self, target: &'t Self::Target, v: u32) -> Option<(Self::Around<'t>, Vector, Vec<Vector>)>;
    /// Moves a vertex to a place in the plane of its star.
    fn move_to(&mut self, v: u32, place: &Vector);
}

/// The target around a place: from places in a plane at height 1 to points of it.
pub(crate) trait TargetAround {
    /// Where a point was found, for the next search nearby.
    type Hint: Clone;

    fn hint(&self) -> Self::Hint;
    /// The image of a place, scaled so that the target's area is that of the surface laid out on.
    fn image(&self, x: &Vector, hint: &mut Self::Hint) -> Point;
}

/// A function of the images of vertices that is part of the energy: its slope at given images, and a bound of how it bends. Images are
/// scaled as [`TargetAround::image`] scales them.
pub(crate) struct ProximalTerm {
    /// For each vertex its image where the slope was measured.
    pub images: Vec<Point>,
    /// The slope by the image of each vertex.
    pub slopes: Vec<Vector>,
    /// The bend as any image moves alone.
    pub masses: Vec<f64>,
    /// The bend as an image and one of its ring move apart, in the order of the ring.
    pub couplings: Vec<Vec<f64>>,
}

/// The same for one vertex, where the others stay: half of `weight` times the square of the distance of its image from a point.
#[derive(Clone, Copy)]
struct Pull {
    to: Point,
    weight: f64,
}

impl ProximalTerm {
    /// For a vertex with these images of its ring.
    fn pull(&self, v: u32, ring: impl Iterator<Item = (u32, Point)>) -> Pull {
        let own = v as usize;
        let (mut weight, mut slope) = (self.masses[own], -self.slopes[own]);
        for ((r, image), coupling) in ring.zip(&self.couplings[own]) {
            weight += coupling;
            slope += (image - self.images[r as usize]) * *coupling;
        }
        Pull {
            to: self.images[own] + slope / weight,
            weight,
        }
    }
}

impl Pull {
    fn energy(&self, image: &Point) -> f64 {
        0.5 * self.weight * (image - self.to).norm_squared()
    }
}

/// Vertices per task.
const LEAST_SWEPT: usize = 16;

/// What sweeps need to know of a layout: to be made again when vertices are inserted.
pub(crate) struct Sweeper<'a, L: Layout> {
    target: &'a L::Target,
    cuts: usize,
    softness: f64,
    /// For each inserted vertex the shapes of its triangles and of their parts, in the order of its ring.
    rests: Vec<Vec<[RestShape; 2]>>,
    /// Indices of inserted vertices, such that no two of a group are neighbours.
    groups: Vec<Vec<usize>>,
    /// Part of the energy.
    pub proximal: Option<ProximalTerm>,
}

/// The triangles of one vertex, cut into parts, as a function of its place. Samples are in layers around the vertex: layer `l` has
/// `l` samples per triangle, and the last one lies on the ring.
struct Star<'a, T> {
    target: T,
    cuts: usize,
    softness: f64,
    rests: &'a [[RestShape; 2]],
    ring: Vec<Vector>,
    /// Images of the last layer, which does not move.
    fixed: Vec<Point>,
    pull: Option<Pull>,
}

impl<'a, L: Layout> Sweeper<'a, L> {
    pub fn new(target: &'a L::Target, layout: &L, points: &[Point], cuts: usize, softness: f64) -> Self {
        let area_scale = layout.area_scale(points);
        let cut = Cut::new(cuts);
        let of_vertex = |&v: &u32| {
            let ring: Vec<u32> = layout.ring(v).collect();
            let next = ring.iter().cycle().skip(1);
            let rest = |(a, b): (&u32, &u32)| {
                let corners = [v, *a, *b].map(|u| &points[u as usize]);
                let rest = RestShape::of_triangle(corners, area_scale);
                [rest, cut.part_of(&rest)]
            };
            ring.iter().zip(next).map(rest).collect()
        };
        Self {
            target,
            cuts,
            softness,
            rests: layout.inserted().par_iter().map(of_vertex).collect(),
            groups: independent_groups(layout, points.len()),
            proximal: None,
        }
    }

    /// Moves each vertex from the one with index `first` on once. Those of one group move at the same time.
    pub fn sweep(&self, layout: &mut L, first: usize) {
        for group in &self.groups {
            let of_group: Vec<usize> = group.iter().copied().filter(|&i| i >= first).collect();
            let moved: Vec<Option<Vector>> = of_group
                .par_iter()
                .with_min_len(LEAST_SWEPT)
                .map(|&i| self.better_place(layout, i))
                .collect();
            for (i, place) in of_group.into_iter().zip(moved) {
                if let Some(place) = place {
                    layout.move_to(layout.inserted()[i], &place);
                }
            }
        }
    }

    fn better_place(&self, layout: &L, index: usize) -> Option<Vector> {
        let v = layout.inserted()[index];
        let (target, x, ring) = layout.star(self.target, v)?;
        let mut star = Star {
            target,
            cuts: self.cuts,
            softness: self.softness,
            rests: &self.rests[index],
            ring,
            fixed: Vec::new(),
            pull: None,
        };
        let last = star.layer(star.cuts, &x);
        star.fixed = star.images(&last, &mut star.target.hint());
        star.pull = self.proximal.as_ref().map(|term| {
            let of_ring = star.fixed.iter().step_by(self.cuts).copied();
            term.pull(v, layout.ring(v).zip(of_ring))
        });
        star.better_place(&x)
    }
}

/// Vertices by colours, such that those of neighbours differ: greedily, in the order of their insertion.
fn independent_groups(layout: &impl Layout, vertices: usize) -> Vec<Vec<usize>> {
    let mut colour = vec![usize::MAX; vertices];
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, &v) in layout.inserted().iter().enumerate() {
        let free = (0..groups.len()).find(|&c| layout.ring(v).all(|r| colour[r as usize] != c));
        let c = free.unwrap_or(groups.len());
        if c == groups.len() {
            groups.push(Vec::new());
        }
        colour[v as usize] = c;
        groups[c].push(i);
    }
    groups
}

/// The mean energy of the images of triangles, 1 for an isometry, where that of a triangle counts up to `most` times that of an isometry.
pub(crate) fn mean_energy<L: Layout>(
    layout: &L,
    target: &L::Target,
    points: &[Point],
    cuts: usize,
    softness: f64,
    most: f64,
) -> f64 {
    let cut = Cut::new(cuts);
    let area_scale = layout.area_scale(points);
    let of_vertex = |&v: &u32| -> [f64; 2] {
        let ids: Vec<u32> = layout.ring(v).collect();
        let mut sums = [0.0; 2];
        let Some((around, x, ring)) = layout.star(target, v) else {
            return sums;
        };
        for i in 0..ids.len() {
            let next = (i + 1) % ids.len();
            // Each triangle once.
            if v > ids[i] || v > ids[next] {
                continue;
            }
            let rest = RestShape::of_triangle([v, ids[i], ids[next]].map(|u| &points[u as usize]), area_scale);
            let part = cut.part_of(&rest);
            let mut hint = around.hint();
            let image = |[l, m, n]: &[f64; 3]| around.image(&(x * *l + ring[i] * *m + ring[next] * *n), &mut hint);
            let images: Vec<Point> = cut.samples.iter().map(image).collect();
            let energy = |corners: &[usize; 3]| image_energy(corners.map(|k| &images[k]), &part, softness);
            let energy: f64 = cut.parts.iter().map(energy).sum();
            sums[0] += energy.min(most * rest.area);
            sums[1] += rest.area;
        }
        sums
    };
    let parts: Vec<[f64; 2]> = layout.inserted().par_iter().map(of_vertex).collect();
    let sum = |k: usize| parts.iter().map(|part| part[k]).sum::<f64>();
    sum(0) / sum(1)
}

impl<T: TargetAround> Star<'_, T> {
    fn images(&self, places: &[Vector], hint: &mut T::Hint) -> Vec<Point> {
        places.iter().map(|x| self.target.image(x, hint)).collect()
    }

    /// The places of a layer, in turn.
    fn layer(&self, layer: usize, x: &Vector) -> Vec<Vector> {
        let (n, share) = (self.ring.len(), layer as f64 / self.cuts as f64);
        let mut places = Vec::with_capacity(n * layer);
        for i in 0..n {
            let (a, b) = (&self.ring[i], &self.ring[(i + 1) % n]);
            for j in 0..layer {
                let along = j as f64 / layer as f64;
                let outer = if j == 0 { *a } else { a * (1.0 - along) + b * along };
                places.push(if layer == self.cuts {
                    outer
                } else {
                    x * (1.0 - share) + outer * share
                });
            }
        }
        places
    }

    /// Places and images of the samples with the vertex at `x`.
    fn samples(&self, x: &Vector) -> (Vec<Vector>, Vec<Point>) {
        let mut places = vec![*x];
        for layer in 1..self.cuts {
            places.extend(self.layer(layer, x));
        }
        let mut images = self.images(&places, &mut self.target.hint());
        places.extend(self.layer(self.cuts, x));
        images.extend_from_slice(&self.fixed);
        (places, images)
    }

    /// The parts of triangle `i`, as indices of samples.
    fn parts(&self, i: usize) -> impl Iterator<Item = [usize; 3]> + '_ {
        let n = self.ring.len();
        let cuts = self.cuts;
        // The sample `a` steps towards one neighbour and `b` towards the next.
        let index = move |a: usize, b: usize| {
            let layer = a + b;
            match layer {
                0 => 0,
                _ => 1 + n * layer * (layer - 1) / 2 + (i * layer + b) % (n * layer),
            }
        };
        (0..cuts).flat_map(move |b| {
            (0..cuts - b).flat_map(move |a| {
                let up = [index(a, b), index(a + 1, b), index(a, b + 1)];
                let down = (a + b + 2 <= cuts).then(|| [index(a + 1, b + 1), index(a, b + 1), index(a + 1, b)]);
                std::iter::once(up).chain(down)
            })
        })
    }

    /// Energy with the vertex at `x`; `None` where a triangle is not positive.
    fn value(&self, x: &Vector) -> Option<f64> {
        let n = self.ring.len();
        let mut sum = 0.0;
        for i in 0..n {
            sum += barrier([x, &self.ring[i], &self.ring[(i + 1) % n]], &self.rests[i][0])?;
        }
        let (_, images) = self.samples(x);
        if let Some(pull) = &self.pull {
            sum += pull.energy(&images[0]);
        }
        for i in 0..n {
            for part in self.parts(i) {
                sum += image_energy(part.map(|k| &images[k]), &self.rests[i][1], self.softness);
            }
        }
        sum.is_finite().then_some(sum)
    }

    /// Derivatives by the place of the vertex, in the plane.
    fn derivatives(&self, x: &Vector) -> Derivatives<2> {
        let n = self.ring.len();
        let (places, images) = self.samples(x);
        let moving = images.len() - self.fixed.len();
        let mut slopes = vec![(Chain::<2>::zeros(), 0.0); moving];
        for i in 0..n {
            for part in self.parts(i) {
                let (slope, area) = secant(part.map(|k| &places[k]), part.map(|k| &images[k]));
                for k in part {
                    if let Some(sum) = slopes.get_mut(k) {
                        sum.0 += slope;
                        sum.1 += area;
                    }
                }
            }
        }
        // How far samples of a layer follow the vertex.
        let mut share = vec![1.0];
        for layer in 1..self.cuts {
            share.extend(std::iter::repeat_n(1.0 - layer as f64 / self.cuts as f64, n * layer));
        }
        let chains: Vec<Chain<2>> = slopes
            .iter()
            .zip(&share)
            .map(|((slope, area), w)| slope * (w / area))
            .collect();
        let still = Chain::<2>::zeros();
        let mut sum = Derivatives::<2>::zeros();
        if let Some(pull) = &self.pull {
            sum.gradient += chains[0].tr_mul(&(images[0] - pull.to)) * pull.weight;
            sum.hessian += chains[0].tr_mul(&chains[0]) * pull.weight;
        }
        for i in 0..n {
            let [rest, part_rest] = &self.rests[i];
            let of_plane = barrier_derivatives([x, &self.ring[i], &self.ring[(i + 1) % n]], rest);
            sum.gradient += of_plane.gradient.fixed_rows::<2>(0);
            sum.hessian += of_plane.hessian.fixed_view::<2, 2>(0, 0);
            for part in self.parts(i) {
                let chains = part.map(|k| chains.get(k).unwrap_or(&still));
                add_image_derivatives(part.map(|k| &images[k]), chains, part_rest, self.softness, &mut sum);
            }
        }
        sum
    }

    /// A Newton step with line search from `x` that lowers the energy; `None` if there is none.
    fn better_place(&self, x: &Vector) -> Option<Vector> {
        let before = self.value(x)?;
        let Derivatives { gradient, hessian } = self.derivatives(x);
        let gradient = Vector::new(gradient[0], gradient[1], 0.0);
        let mut in_space = Matrix3::zeros();
        in_space.fixed_view_mut::<2, 2>(0, 0).copy_from(&hessian);
        let step = Curvature::Flat.newton_step(x, &gradient, &in_space)?;
        let slope = gradient.dot(&step).abs();
        lower_along(before, slope, |share| {
            let to = x + step * share;
            Some((self.value(&to)?, to))
        })
    }
}
