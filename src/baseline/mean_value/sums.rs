//! The integrals behind mean value coordinates, summed over all triangles for eight points at a time.
//!
//! # Notation
//!
//! `v` is the point; `d = p − v` leads to a vertex `p`; `E` is an edge. A triangle has the outward normal `n`, the
//! height `h = n · d` and, for each side, the outward normal `b = E × n` in its plane, as long as the side, and
//! `α = d · b`. Its image coordinates continue over its plane with the gradient `G`, constant along `n`; `φ` is their
//! value at the foot of `v`. The integrals are
//!
//! - over an edge, `κ₂ₙ = ∫₀¹ dt / r²ⁿ`: `κ = κ₂` is the angle seen from `v` over `|d × E|`;
//! - over a triangle, `J = ∫ dA / r⁴ = Σ κ α / 2h²` and the denominator's share `s = h J`;
//! - `∫ ω dω = m = ½ Σ κ (d × E)` over directions `ω`, whence the numerator's share `φ s + G m`.
//!
//! Differentiation by `v` gives `∇κ = 2 ∫ d / r⁴ dt` and `∇s = n (J + Σ α κ₄) − h Σ b κ₄`, nothing of which divides by
//! what may vanish, save `J`: where `v` is close to the plane of a triangle but beside it, the sum cancels, and a
//! series in `h²` takes its place.
//!
//! `m` and `s` are Ju et al.'s; their weights follow from `Σ w_j d_j = m`. Shares of an edge serve both its triangles:
//! those of `G m` are summed by edges with the difference of the two `G`.

use crate::simd::{Computation, Instructions, Portable, Simd};
use crate::{Matrix3, Point, Vector};

/// Points of a [`PointBlock`]: a multiple of every vector width.
pub(super) const LANES: usize = 8;

/// Numerator (3), denominator, and when gradients are wanted those of the numerator (9, row-major) and the denominator.
pub(super) type BlockSums = [[f64; LANES]; 16];
const DENOMINATOR: usize = 3;
const NUMERATOR_GRADIENT: usize = 4;
const DENOMINATOR_GRADIENT: usize = 13;

/// Points, and for each the image that the numerator is taken relative to. Both are arrays of coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointBlock {
    pub(super) points: [[f64; LANES]; 3],
    pub(super) origins: [[f64; LANES]; 3],
}

/// Neighbouring triangles and their edges, few enough for the integrals over edges to stay in the first-level cache.
#[derive(Debug, Clone)]
pub(super) struct TrianglePatch {
    pub(super) edges: Vec<PatchEdge>,
    pub(super) triangles: Vec<PatchTriangle>,
}

/// An edge from the lower vertex to the higher.
#[derive(Debug, Clone)]
pub(super) struct PatchEdge {
    start: [f64; 3],
    along: [f64; 3],
    length_squared: f64,
    /// Row-major `T` such that `−κ T d` is the share of the edge in `Σ G m`.
    turn: [f64; 9],
}

/// A triangle with an area. Sides and corners are counted as in [`crate::mesh::topology::Side`].
#[derive(Debug, Clone)]
pub(super) struct PatchTriangle {
    corners: [Point; 3],
    /// In the patch, by side.
    edges: [u32; 3],
    normal: [f64; 3],
    /// `b` of sides 0 and 2: they meet in corner 0, and the three sum to zero.
    side_normals: [[f64; 3]; 2],
    /// The sum of `α` over the three sides.
    twice_area: f64,
    first_image: [f64; 3],
    /// Row-major.
    gradient: [f64; 9],
}

impl PatchEdge {
    pub(super) fn new(start: Point, end: Point) -> Self {
        let along = end - start;
        Self {
            start: start.coords.into(),
            along: along.into(),
            length_squared: along.norm_squared(),
            turn: [0.0; 9],
        }
    }

    /// Adds the share of a triangle that passes the edge `forward`, from start to end, or backward.
    pub(super) fn attach(&mut self, triangle: &PatchTriangle, forward: bool) {
        let half = if forward { 0.5 } else { -0.5 };
        let turn = Matrix3::from_row_slice(&triangle.gradient) * Vector::from(self.along).cross_matrix() * half;
        for (entry, share) in self.turn.iter_mut().zip(turn.transpose().iter()) {
            *entry += share;
        }
    }
}

impl PatchTriangle {
    /// `None` where the height is negligible against the longest side: the share of such a triangle is as small, and
    /// its plane and gradient are noise.
    pub(super) fn new(corners: [Point; 3], images: [Point; 3], edges: [u32; 3]) -> Option<Self> {
        let sides: [Vector; 3] = std::array::from_fn(|k| corners[(k + 1) % 3] - corners[k]);
        let area_vector = sides[0].cross(&sides[1]);
        let twice_area = area_vector.norm();
        let longest_squared = sides.iter().map(Vector::norm_squared).fold(0.0, f64::max);
        if twice_area <= NO_HEIGHT * longest_squared {
            return None;
        }
        let normal = area_vector / twice_area;
        let side_normals = sides.map(|side| side.cross(&normal));
        // The hat function of a corner falls along `b` of the opposite side.
        let gradient = (0..3).fold(Matrix3::zeros(), |sum, k| {
            let opposite = side_normals[(k + 1) % 3] / -twice_area;
            sum + (images[k] - images[0]) * opposite.transpose()
        });
        Some(Self {
            corners,
            edges,
            normal: normal.into(),
            side_normals: [side_normals[0].into(), side_normals[2].into()],
            twice_area,
            first_image: images[0].coords.into(),
            gradient: std::array::from_fn(|i| gradient[(i / 3, i % 3)]),
        })
    }
}

/// Height over longest side below which a triangle is left out.
const NO_HEIGHT: f64 = 1e-10;

/// Height over distance in the plane below which `J` is taken from its series. At this height the closed form has lost
/// `ε/FLAT²`, and the series is off by `3 FLAT⁴`: 2e-10 and 3e-12.
const FLAT: f64 = 1e-3;

/// Sums over all patches for each block; gradients only if asked for.
pub(super) fn sum(
    instructions: Instructions,
    patches: &[TrianglePatch],
    blocks: &[PointBlock],
    with_gradient: bool,
) -> Vec<BlockSums> {
    if with_gradient {
        instructions.run(PatchSums::<true> { patches, blocks })
    } else {
        instructions.run(PatchSums::<false> { patches, blocks })
    }
}

struct PatchSums<'a, const GRADIENT: bool> {
    patches: &'a [TrianglePatch],
    blocks: &'a [PointBlock],
}

impl<const GRADIENT: bool> Computation for PatchSums<'_, GRADIENT> {
    type Output = Vec<BlockSums>;

    /// Patch after patch, each for all points while it is in the cache. Every patch is summed on its own, which also
    /// keeps rounding errors from growing with the number of triangles.
    #[inline(always)]
    fn run<V: Simd>(self, token: V::Token) -> Vec<BlockSums> {
        let Self { patches, blocks } = self;
        let mut sums = vec![[[0.0; LANES]; 16]; blocks.len()];
        let most_edges = patches.iter().map(|patch| patch.edges.len()).max().unwrap_or(0);
        let mut along_edges = vec![[V::splat(token, 0.0); 2]; most_edges];
        for patch in patches {
            for (block, sums) in blocks.iter().zip(&mut sums) {
                for first in (0..LANES).step_by(V::WIDTH) {
                    let load = |axis: &[f64; LANES]| V::load(token, &axis[first..]);
                    let at = block.points.each_ref().map(load);
                    let origin = block.origins.each_ref().map(load);
                    let mut sum = [V::splat(token, 0.0); 16];
                    add_edges::<V, GRADIENT>(token, &patch.edges, at, &mut along_edges, &mut sum);
                    add_triangles::<V, GRADIENT>(token, &patch.triangles, at, origin, &along_edges, &mut sum);
                    let count = if GRADIENT { 16 } else { 4 };
                    for (sum, sums) in sum[..count].iter().zip(&mut *sums) {
                        let sums = &mut sums[first..];
                        (V::load(token, sums) + *sum).store(sums);
                    }
                }
            }
        }
        sums
    }
}

/// Adds the shares of edges in `Σ G m`, and writes `κ` and, with gradients, `κ₄`.
#[inline(always)]
fn add_edges<V: Simd, const GRADIENT: bool>(
    token: V::Token,
    edges: &[PatchEdge],
    at: [V; 3],
    along_edges: &mut [[V; 2]],
    sum: &mut [V; 16],
) {
    let splat = |value| V::splat(token, value);
    let mut part = *sum;
    for (edge, integrals) in edges.iter().zip(along_edges) {
        let along = edge.along.map(splat);
        let length_squared = splat(edge.length_squared);
        let d: [V; 3] = std::array::from_fn(|k| splat(edge.start[k]) - at[k]);
        let forward = dot(d, along);
        let Segment { kappa, r, slope } = segment::<V, GRADIENT>(token, d, along, forward);
        let turned: [V; 3] = std::array::from_fn(|i| row(token, &edge.turn, i, d));
        let minus_kappa = -kappa;
        for i in 0..3 {
            part[i] = turned[i].mul_add(minus_kappa, part[i]);
        }
        if GRADIENT {
            let across = length_squared * slope;
            *integrals = [kappa, across.mul_add(splat(0.5), r)];
            let of_d = r + r + across;
            let of_along = r - forward * slope;
            // `−∇κ`.
            let gradient: [V; 3] = std::array::from_fn(|k| -d[k].mul_add(of_d, along[k] * of_along));
            for i in 0..3 {
                for k in 0..3 {
                    let entry = &mut part[NUMERATOR_GRADIENT + 3 * i + k];
                    *entry = turned[i].mul_add(gradient[k], *entry);
                    *entry = splat(edge.turn[3 * i + k]).mul_add(kappa, *entry);
                }
            }
        } else {
            integrals[0] = kappa;
        }
    }
    *sum = part;
}

/// What the integrals over an edge are made of, with `A = d_i · d_j` and `C = |d_i × d_j|²`.
#[derive(Clone, Copy)]
struct Segment<V> {
    /// `κ`.
    kappa: V,
    /// `1 / (A² + C) = 1 / r_i² r_j²`.
    r: V,
    /// `(κ − A / (A² + C)) / C`: `κ₄ = r + ½ |E|² slope`.
    slope: V,
}

#[inline(always)]
fn segment<V: Simd, const GRADIENT: bool>(token: V::Token, d: [V; 3], along: [V; 3], forward: V) -> Segment<V> {
    let c = cross(d, along);
    let c = dot(c, c);
    let a = dot(d, d) + forward;
    // With `z = C/A²`, the squared tangent of the angle: by series in `z` if it is small, as for all but the nearest
    // edges. Then nothing cancels, not even where `v` lies on the line of the edge.
    let inverse = a.reciprocal();
    let squared = inverse * inverse;
    let z = c * squared;
    let arctan = arctan_over_argument(token, z);
    let mut result = Segment {
        kappa: inverse * arctan,
        r: squared,
        slope: squared,
    };
    if GRADIENT {
        let difference = arctan_minus_rational(token, z);
        result.slope = difference * (squared * inverse);
        // `arctan − z · difference` is `1 / (1 + z)`.
        result.r = squared * (-z).mul_add(difference, arctan);
    }
    let limit = a * a.abs() * V::splat(token, SERIES);
    if c.less(limit) != (1 << V::WIDTH) - 1 {
        let wide = wide_segment(token, a, c);
        result.kappa = c.if_less(limit, result.kappa, wide.kappa);
        result.r = c.if_less(limit, result.r, wide.r);
        result.slope = c.if_less(limit, result.slope, wide.slope);
    }
    result
}

/// [`segment`] for a single point.
fn scalar_segment(d: Vector, along: Vector) -> Segment<f64> {
    let vector = |v: Vector| [v.x, v.y, v.z].map(|c| Portable([c]));
    let forward = Portable([d.dot(&along)]);
    let Segment { kappa, r, slope } = segment::<_, true>((), vector(d), vector(along), forward);
    Segment {
        kappa: kappa.0[0],
        r: r.0[0],
        slope: slope.0[0],
    }
}

/// Limit of the series in `z`: their eighth power is below the rounding error.
const SERIES: f64 = 1.0 / 64.0;

/// `arctan(√z) / √z = 1 − z/3 + z²/5 − …`
#[inline(always)]
fn arctan_over_argument<V: Simd>(token: V::Token, z: V) -> V {
    const TERMS: [f64; 8] = [
        -1.0 / 15.0,
        1.0 / 13.0,
        -1.0 / 11.0,
        1.0 / 9.0,
        -1.0 / 7.0,
        1.0 / 5.0,
        -1.0 / 3.0,
        1.0,
    ];
    horner(token, &TERMS, z)
}

/// `(arctan(√z) / √z − 1 / (1 + z)) / z = 2/3 − 4z/5 + 6z²/7 − …`
#[inline(always)]
fn arctan_minus_rational<V: Simd>(token: V::Token, z: V) -> V {
    const TERMS: [f64; 8] = [
        -16.0 / 17.0,
        14.0 / 15.0,
        -12.0 / 13.0,
        10.0 / 11.0,
        -8.0 / 9.0,
        6.0 / 7.0,
        -4.0 / 5.0,
        2.0 / 3.0,
    ];
    horner(token, &TERMS, z)
}

#[inline(always)]
fn horner<V: Simd>(token: V::Token, terms: &[f64; 8], z: V) -> V {
    terms[1..].iter().fold(V::splat(token, terms[0]), |sum, &term| {
        sum.mul_add(z, V::splat(token, term))
    })
}

/// The integrals where the angle is not small.
#[inline(always)]
fn wide_segment<V: Simd>(token: V::Token, a: V, c: V) -> Segment<V> {
    let splat = |value| V::splat(token, value);
    let sine = c.sqrt();
    let lengths = a.mul_add(a, c);
    // The tangent of half the angle between `d_i` and `± d_j`, at most one, less the nearest quarter.
    let tangent = sine / (lengths.sqrt() + a.abs());
    let (mut quarter, mut turned) = (splat(0.0), splat(0.0));
    for k in 1..=4 {
        let nearest = 0.25 * f64::from(k);
        let beyond = splat(nearest - 0.125);
        quarter = beyond.if_less(tangent, splat(nearest), quarter);
        turned = beyond.if_less(tangent, splat(nearest.atan()), turned);
    }
    let rest = (tangent - quarter) / tangent.mul_add(quarter, splat(1.0));
    let half = rest.mul_add(arctan_over_argument(token, rest * rest), turned);
    let angle = half + half;
    let angle = a.if_less(splat(0.0), splat(std::f64::consts::PI) - angle, angle);
    let kappa = angle / sine;
    let r = splat(1.0) / lengths;
    Segment {
        kappa,
        r,
        slope: (kappa - a * r) / c,
    }
}

/// Adds the shares `φ s` and `s` of triangles.
#[inline(always)]
fn add_triangles<V: Simd, const GRADIENT: bool>(
    token: V::Token,
    triangles: &[PatchTriangle],
    at: [V; 3],
    origin: [V; 3],
    along_edges: &[[V; 2]],
    sum: &mut [V; 16],
) {
    let splat = |value| V::splat(token, value);
    let mut part = *sum;
    for triangle in triangles {
        let normal = triangle.normal.map(splat);
        let [b0, b2] = triangle.side_normals.map(|b| b.map(splat));
        let twice_area = splat(triangle.twice_area);
        let corner: [f64; 3] = triangle.corners[0].coords.into();
        let d: [V; 3] = std::array::from_fn(|k| splat(corner[k]) - at[k]);
        let h = dot(normal, d);
        let (alpha0, alpha2) = (dot(b0, d), dot(b2, d));
        let [e0, e1, e2] = triangle.edges.map(|edge| along_edges[edge as usize]);
        // `Σ α κ` with the third `α` from their sum.
        let weighed = |i: usize| alpha0.mul_add(e0[i] - e1[i], alpha2.mul_add(e2[i] - e1[i], twice_area * e1[i]));
        let h_squared = h * h;
        let mut j = weighed(0) * splat(0.5) * h_squared.reciprocal();
        let flat = h_squared.less(dot(d, d) * splat(FLAT * FLAT));
        if flat != 0 {
            j = replace_flat(token, triangle, at, flat, j);
        }
        let s = h * j;
        let phi: [V; 3] =
            std::array::from_fn(|i| splat(triangle.first_image[i]) - origin[i] - row(token, &triangle.gradient, i, d));
        for i in 0..3 {
            part[i] = phi[i].mul_add(s, part[i]);
        }
        part[DENOMINATOR] = part[DENOMINATOR] + s;
        if GRADIENT {
            let upward = j + weighed(1);
            let (across0, across2) = (h * (e1[1] - e0[1]), h * (e1[1] - e2[1]));
            for k in 0..3 {
                let gradient = normal[k].mul_add(upward, b0[k].mul_add(across0, b2[k] * across2));
                let entry = &mut part[DENOMINATOR_GRADIENT + k];
                *entry = *entry + gradient;
                for i in 0..3 {
                    let entry = &mut part[NUMERATOR_GRADIENT + 3 * i + k];
                    *entry = phi[i].mul_add(gradient, *entry);
                    *entry = splat(triangle.gradient[3 * i + k]).mul_add(s, *entry);
                }
            }
        }
    }
    *sum = part;
}

/// `J` with the series in place of the closed form in those of the `flat` lanes that call for it.
#[cold]
#[inline(never)]
fn replace_flat<V: Simd>(token: V::Token, triangle: &PatchTriangle, at: [V; 3], flat: u32, j: V) -> V {
    let mut points = [[0.0; LANES]; 3];
    let mut values = [0.0; LANES];
    for (axis, points) in at.iter().zip(&mut points) {
        axis.store(points);
    }
    j.store(&mut values);
    for lane in (0..V::WIDTH).filter(|lane| flat >> lane & 1 == 1) {
        let point = Point::from(points.map(|axis| axis[lane]));
        values[lane] = flat_integral(triangle, point).unwrap_or(values[lane]);
    }
    V::load(token, &values)
}

/// `J` to second order in the height, by the divergence theorem in the plane: `J = −½ Σ α κ₄ + 2 h² ∫ dA / r⁶` and
/// `∫ dA / r⁶ ≈ −¼ Σ α κ₆`. `None` unless the point is close to the plane and beside the triangle.
fn flat_integral(triangle: &PatchTriangle, point: Point) -> Option<f64> {
    let normal = Vector::from(triangle.normal);
    let h = normal.dot(&(triangle.corners[0] - point));
    let (mut beside, mut fourth, mut sixth) = (0.0f64, 0.0, 0.0);
    for k in 0..3 {
        let (start, end) = (triangle.corners[k], triangle.corners[(k + 1) % 3]);
        let (d, along) = (start - point, end - start);
        let alpha = d.dot(&along.cross(&normal));
        let length_squared = along.norm_squared();
        beside = beside.max(-alpha / length_squared.sqrt());
        let segment = scalar_segment(d, along);
        let kappa4 = segment.r + 0.5 * length_squared * segment.slope;
        fourth -= alpha * kappa4;
        sixth -= alpha * sixth_power_integral(d, end - point, length_squared, segment.kappa, kappa4);
    }
    (h.abs() < FLAT * beside).then_some(fourth / 2.0 + 2.0 * h * h * sixth / 4.0)
}

/// `κ₆`, to 1e-6 or better, which is enough for a correction.
fn sixth_power_integral(from: Vector, to: Vector, length_squared: f64, kappa: f64, kappa4: f64) -> f64 {
    let cross_squared = from.cross(&(to - from)).norm_squared();
    let cosine = from.dot(&to);
    if cosine > 0.0 && cross_squared < 1e-3 * cosine * cosine {
        // With the angle `θ` between, `1/r` runs from one end to the other as `(sin(θ−ψ)/r_i + sin ψ/r_j) / sin θ`.
        // Its fourth power, integrated to second order in `θ`.
        let correction = cross_squared / (cosine * cosine) / 6.0;
        let mean = [120.0, 66.0, 48.0, 66.0, 120.0].map(|m| 0.2 + correction * (0.8 - m / 210.0));
        let (near, far) = (1.0 / from.norm(), 1.0 / to.norm());
        let powers = (0..5).map(|k| mean[k as usize] * near.powi(4 - k) * far.powi(k));
        return kappa * powers.sum::<f64>();
    }
    let distance_squared = cross_squared / length_squared;
    let along = to - from;
    let ends = to.dot(&along) / to.norm_squared().powi(2) - from.dot(&along) / from.norm_squared().powi(2);
    (ends / length_squared + 3.0 * kappa4) / (4.0 * distance_squared)
}

#[inline(always)]
fn dot<V: Simd>(a: [V; 3], b: [V; 3]) -> V {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

#[inline(always)]
fn cross<V: Simd>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    std::array::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        a[i].mul_add(b[j], -(a[j] * b[i]))
    })
}

/// Row `i` of a row-major matrix times a vector.
#[inline(always)]
fn row<V: Simd>(token: V::Token, matrix: &[f64; 9], i: usize, d: [V; 3]) -> V {
    dot(std::array::from_fn(|k| V::splat(token, matrix[3 * i + k])), d)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> PatchTriangle {
        let corners = [[0.2, -0.1, 0.3], [1.1, 0.2, 0.2], [0.4, 0.9, 0.6]].map(Point::from);
        PatchTriangle::new(corners, corners, [0, 1, 2]).unwrap()
    }

    /// Points `height` above the plane, beside each side and beyond each corner, near and far.
    fn points_beside(triangle: &PatchTriangle, height: f64) -> Vec<Point> {
        let [a, b, c] = triangle.corners;
        let weights = [
            [0.5, 0.6, -0.1],
            [-0.2, 0.4, 0.8],
            [1.4, -0.2, -0.2],
            [-3.0, 2.0, 2.0],
            [9.0, -4.0, -4.0],
        ];
        let at = |[u, v, w]: [f64; 3]| a.coords * u + b.coords * v + c.coords * w;
        weights
            .map(|w| Point::from(at(w) - Vector::from(triangle.normal) * height))
            .to_vec()
    }

    /// `∫ dA / r^power` by the midpoint rule on `4^levels` equal triangles, extrapolated from three such.
    fn integrate(triangle: &PatchTriangle, point: &Point, power: i32) -> f64 {
        let rule = |n: usize| {
            let [a, b, c] = triangle.corners;
            let centre = |i: f64, j: f64| a + (b - a) * (i / n as f64) + (c - a) * (j / n as f64);
            let value = |p: Point| (p - point).norm().powi(-power);
            let mut sum = 0.0;
            for i in 0..n {
                for j in 0..n - i {
                    let (i, j) = (i as f64, j as f64);
                    sum += value(centre(i + 1.0 / 3.0, j + 1.0 / 3.0));
                    if i + j < n as f64 - 1.0 {
                        sum += value(centre(i + 2.0 / 3.0, j + 2.0 / 3.0));
                    }
                }
            }
            sum * triangle.twice_area / 2.0 / (n * n) as f64
        };
        let rules = [60, 120, 240].map(rule);
        let once = [0, 1].map(|k| (4.0 * rules[k + 1] - rules[k]) / 3.0);
        (16.0 * once[1] - once[0]) / 15.0
    }

    #[test]
    fn the_series_for_low_points_matches_quadrature() {
        let triangle = triangle();
        for height in [0.0, 1e-9, 1e-5, -3e-5] {
            for point in points_beside(&triangle, height) {
                let series = flat_integral(&triangle, point).unwrap();
                let expected = integrate(&triangle, &point, 4);
                // The midpoint rule's error, on cells a tenth of the nearest distance.
                assert!((series / expected - 1.0).abs() < 1e-6, "{point} {series} {expected}");
            }
        }
    }

    #[test]
    fn the_series_for_low_points_meets_the_closed_form() {
        let triangle = triangle();
        for point in points_beside(&triangle, 0.0) {
            let mut low = 1.0;
            while flat_integral(&triangle, point + Vector::from(triangle.normal) * low).is_none() {
                low /= 1.5;
            }
            let point = point + Vector::from(triangle.normal) * low;
            let series = flat_integral(&triangle, point).unwrap();
            let kappa_alpha: f64 = (0..3)
                .map(|k| {
                    let (start, end) = (triangle.corners[k], triangle.corners[(k + 1) % 3]);
                    let (d, along) = (start - point, end - start);
                    let kappa = scalar_segment(d, along).kappa;
                    kappa * d.dot(&along.cross(&Vector::from(triangle.normal)))
                })
                .sum();
            let closed = kappa_alpha / (2.0 * low * low);
            // What the closed form loses here: rounding over `h²`, times distance over size for the far points.
            assert!((series / closed - 1.0).abs() < 1e-7, "{point}: {series} {closed}");
        }
    }

    #[test]
    fn integrals_over_edges_match_quadrature() {
        let along = Vector::new(1.0, 0.5, -0.3);
        for from in [
            Vector::new(0.3, 0.1, 0.2),
            Vector::new(-0.5, -0.1, 0.2),
            Vector::new(4.0, 5.0, 3.0),
            Vector::new(2.0, 1.0, -0.6),
            Vector::new(2.0, 1.0, -0.6 + 1e-9),
            Vector::new(20.0, -30.0, 7.0),
            Vector::new(-0.5, 0.2, 0.1),
        ] {
            let numeric = |power: i32| {
                let n = 2000;
                // Simpson's rule.
                let at = |k: usize| (from + along * (k as f64 / n as f64)).norm().powi(-power);
                let inner: f64 = (1..n).map(|k| at(k) * if k % 2 == 1 { 4.0 } else { 2.0 }).sum();
                (at(0) + inner + at(n)) / (3 * n) as f64
            };
            let integrals = scalar_segment(from, along);
            let kappa4 = integrals.r + 0.5 * along.norm_squared() * integrals.slope;
            let kappa6 = sixth_power_integral(from, from + along, along.norm_squared(), integrals.kappa, kappa4);
            assert!((integrals.kappa / numeric(2) - 1.0).abs() < 1e-10);
            assert!((kappa4 / numeric(4) - 1.0).abs() < 1e-9);
            let expected = numeric(6);
            assert!((kappa6 / expected - 1.0).abs() < 1e-5, "{from}: {kappa6} {expected}");
        }
    }

    #[test]
    fn triangles_without_height_do_not_count() {
        let line = [0.0, 1.0, 2.0].map(|x| Point::new(x, 0.3 * x, 0.0));
        assert!(PatchTriangle::new(line, line, [0, 1, 2]).is_none());
        assert!(PatchTriangle::new([line[0]; 3], line, [0, 1, 2]).is_none());
    }
}
