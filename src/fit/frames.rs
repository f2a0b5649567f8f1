//! Images of fixed points for one frame after the other, where frames have most of their motion in common.
//!
//! A map is linear in its boundary values. Each frame is expanded in orthonormal modes over the vertices, whose maps have been
//! evaluated at the points once; what the modes leave is solved for, and becomes further modes. A frame that needs none costs
//! two products with the modes' values. By the maximum principle, what is left out counts for no more inside than at the boundary.
//!
//! # References
//!
//! Sirovich, *Turbulence and the dynamics of coherent structures*, Quart. Appl. Math. 45 (1987), for modes of frames;
//! Daniel, Gragg, Kaufman, Stewart, *Reorthogonalization and stable algorithms for updating the Gram-Schmidt QR
//! factorization*, Math. Comp. 30 (1976), for orthogonalising twice.

use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::held_out::{MAX_SUM_ERROR, sum_accuracy};
use super::phase::{Phase, Progress};
use super::system::Evaluator;
use super::{DomainFactor, FitError};
use crate::boundary_map::BoundaryMap;
use crate::mesh::SurfacePoint;
use crate::progress::ProgressResponse;
use crate::solver::Values;
use crate::{Point, Vector};

/// Part of the residual tolerance that may be left out on average, as in blocks of frames; and of the tolerance, anywhere.
const LEFT_OUT: f64 = 0.1;
/// A direction that shrinks to less than this when it is made orthogonal to others depends on them.
const DEPENDENT: f64 = 1e-10;
/// Points whose values are combined by one task.
const POINTS_PER_TASK: usize = 1 << 11;

/// Images of fixed points in a domain under the maps of its frames, one after the other.
///
/// The first frames cost a solution each, as [`DomainFactor::solve`]. Later ones that move as combinations of those before do
/// cost `6 · modes · (2 · vertices + points)` flops: a skinned animation of `B` bones has at most `4 · B` modes.
///
/// Keeps `8 · (vertices + points + held-out points)` bytes for each mode.
pub struct FrameEvaluator {
    factor: Arc<DomainFactor>,
    points: usize,
    /// At the points, then at the held-out points.
    evaluator: Evaluator,
    /// Shares of the vertices in the area.
    weights: Vec<f64>,
    modes: Modes,
    most_modes: usize,
}

/// The images of the points in one frame, and how far they can be trusted.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameImages {
    /// Where the points go: an image for each, in the same order.
    pub images: Vec<Point>,
    /// Root mean square of the map's distance from the frame at held-out points of the boundary, over the frame's diagonal: at
    /// most that.
    pub boundary_rms: f64,
    /// The largest distance between the frame and what was solved for in its place, over the frame's diagonal. By the maximum
    /// principle, that changes no image by more.
    pub left_out: f64,
    /// Modes that were solved for, up to three; with none, the frame was a combination of earlier ones.
    pub solved: usize,
}

impl FrameEvaluator {
    /// For points inside the domain, in model units. Keeps at most `most_modes` modes, the affine functions included, which are kept in
    /// any case; frames that need others are then solved for one by one.
    ///
    /// # Errors
    ///
    /// [`FitError::Solve`] for more points than the kernel's sums can number.
    pub fn new(factor: Arc<DomainFactor>, points: &[Point], most_modes: usize) -> Result<Self, FitError> {
        let domain = &factor.domain;
        let (_, held_out) = factor.held_out.even();
        let evaluated = [points, held_out].concat();
        let areas = domain.vertex_areas();
        let total: f64 = areas.iter().sum();
        let mut modes = Modes::new(domain.vertices().len(), points.len(), held_out.len());
        let weights: Vec<f64> = areas.iter().map(|area| area / total).collect();
        if factor.options.affine {
            modes.append(&affine_modes(domain.vertices(), points, held_out.len(), &weights));
        }
        Ok(Self {
            evaluator: factor.system.evaluator(&evaluated, MAX_SUM_ERROR)?,
            points: points.len(),
            weights,
            modes,
            most_modes,
            factor,
        })
    }

    /// How many modes are kept, the affine functions included.
    pub fn modes(&self) -> usize {
        self.modes.count()
    }

    /// The images of the points under the map that carries the domain's vertices to `images`.
    ///
    /// # Errors
    ///
    /// As [`DomainFactor::solve`]; [`FitError::BoundaryMap`] where `images` are not a position for each vertex.
    pub fn evaluate<R: ProgressResponse>(
        &mut self,
        images: Vec<Point>,
        progress: &dyn Fn(Phase) -> R,
    ) -> Result<FrameImages, FitError> {
        let boundary = BoundaryMap::new(self.factor.domain.clone(), images)?;
        let (low, high) = boundary.target_box();
        let (origin, diagonal) = (nalgebra::center(&low, &high), (high - low).norm());
        let images = boundary.image();
        let data = Mat::from_fn(images.len(), 3, |v, k| (images[v][k] - origin[k]) / diagonal);

        let (mut coefficients, mut rest) = self.modes.expanded(&data, &self.weights);
        let mut added = Modes::new(images.len(), self.points, self.modes.held_out);
        let mut own = Mat::zeros(0, 3);
        if !self.is_negligible(&rest) {
            let respond = |phase| progress(phase).control_flow();
            added = self.solved(&rest, &Progress(&respond))?;
            (own, rest) = added.expanded(&rest, &self.weights);
        }
        let solved = added.count();
        let mut added_rms = added.mean_square_error(&own).sqrt();
        let mut values = added.combined(&own);
        if solved > 0 && self.modes.count() + solved <= self.most_modes {
            self.modes.append(&added);
            coefficients = Mat::from_fn(coefficients.nrows() + solved, 3, |i, k| {
                match i.checked_sub(coefficients.nrows()) {
                    Some(i) => own[(i, k)],
                    None => coefficients[(i, k)],
                }
            });
            (values, added_rms) = (vec![Vector::zeros(); self.points], 0.0);
        }
        let known = self.modes.combined(&coefficients);
        let images = known.par_iter().zip(&values);
        let left_out = self.sizes(&rest);
        Ok(FrameImages {
            images: images.map(|(a, b)| origin + (a + b) * diagonal).collect(),
            boundary_rms: self.modes.mean_square_error(&coefficients).sqrt() + added_rms + left_out.rms,
            left_out: left_out.largest,
            solved,
        })
    }

    fn is_negligible(&self, rest: &Mat<f64>) -> bool {
        let (sizes, options) = (self.sizes(rest), &self.factor.options);
        sizes.rms <= LEFT_OUT * options.residual_tolerance() && sizes.largest <= LEFT_OUT * options.tolerance
    }

    /// Root mean square, by area, and largest length of a displacement of the vertices.
    fn sizes(&self, displacement: &Mat<f64>) -> Sizes {
        let square = |v: usize| (0..3).map(|k| displacement[(v, k)].powi(2)).sum::<f64>();
        let used = || (0..displacement.nrows()).filter(|&v| self.weights[v] > 0.0);
        Sizes {
            rms: used().map(|v| self.weights[v] * square(v)).sum::<f64>().sqrt(),
            largest: used().map(square).fold(0.0, f64::max).sqrt(),
        }
    }

    /// Modes for a displacement of the vertices that has no part in those there are.
    fn solved(&self, displacement: &Mat<f64>, progress: &Progress) -> Result<Modes, FitError> {
        let DomainFactor {
            domain,
            system,
            held_out,
            options,
            ..
        } = &*self.factor;
        let mut modes = Modes::new(domain.vertices().len(), self.points, self.modes.held_out);
        // Once more against the modes that there are, which rounding makes necessary.
        let (_, again) = self.modes.expanded(displacement, &self.weights);
        let least = LEFT_OUT / 3.0 * options.residual_tolerance();
        let (directions, _) = orthonormal(again, &self.weights, least);
        if directions.ncols() == 0 {
            return Ok(modes);
        }
        let as_points = |v: usize| {
            Point::from(Vector::from_fn(|k, _| {
                if k < directions.ncols() {
                    directions[(v, k)]
                } else {
                    0.0
                }
            }))
        };
        let positions: Vec<Point> = (0..directions.nrows()).map(as_points).collect();
        let at = |points: &[SurfacePoint]| {
            let values = points
                .iter()
                .flat_map(|p| p.position(domain, &positions).coords.data.0[0]);
            Values::new(3, values.collect())
        };
        let solution = system.solve(&at(&system.collocation), None, options.residual_tolerance(), progress)?;
        progress.enter(Phase::Measuring)?;
        let accuracy = sum_accuracy(solution.expected_error());
        let values = self.evaluator.values(system, &solution, accuracy)?;
        let exact = at(held_out.even().0);
        for k in 0..directions.ncols() {
            modes.vertices.extend_from_slice(directions.col_as_slice(k));
            modes.points.extend((0..self.points).map(|p| values.row(p)[k]));
            modes
                .errors
                .extend((0..exact.rows()).map(|h| values.row(self.points + h)[k] - exact.row(h)[k]));
        }
        modes.update_products();
        match modes.points.iter().chain(&modes.errors).all(|value| value.is_finite()) {
            true => Ok(modes),
            false => Err(FitError::NonFiniteMap),
        }
    }
}

/// The functions 1, x, y, z, which the maps have exactly; none where they depend on each other over the vertices.
fn affine_modes(vertices: &[Point], points: &[Point], held_out: usize, weights: &[f64]) -> Modes {
    let mut modes = Modes::new(vertices.len(), points.len(), held_out);
    let (centre, size) = (
        vertices[0],
        vertices
            .iter()
            .map(|p| (p - vertices[0]).amax())
            .fold(f64::MIN_POSITIVE, f64::max),
    );
    let values = |points: &[Point]| {
        let unit = |p: &Point, k: usize| if k == 0 { 1.0 } else { (p[k - 1] - centre[k - 1]) / size };
        Mat::from_fn(points.len(), 4, |i, k| unit(&points[i], k))
    };
    let (at_vertices, triangle) = orthonormal(values(vertices), weights, 0.0);
    if at_vertices.ncols() < 4 {
        return modes;
    }
    // The same combinations at the points: X R⁻¹.
    let mut at_points = values(points);
    solve_lower_triangular_in_place(triangle.transpose(), at_points.as_mut().transpose_mut(), Par::Seq);
    modes.vertices = entries(&at_vertices);
    modes.points = entries(&at_points);
    modes.errors = vec![0.0; 4 * held_out];
    modes.update_products();
    modes
}

struct Sizes {
    rms: f64,
    largest: f64,
}

/// Functions on the boundary whose harmonic extensions are known, column after column.
struct Modes {
    rows: usize,
    inside: usize,
    held_out: usize,
    /// At the vertices: orthonormal, weighted by area.
    vertices: Vec<f64>,
    /// The extensions at the points.
    points: Vec<f64>,
    /// The extensions at held-out points of the boundary, less what they should be there.
    errors: Vec<f64>,
    /// Mean products of the errors of any two modes.
    error_products: Mat<f64>,
}

impl Modes {
    fn new(vertices: usize, points: usize, held_out: usize) -> Self {
        Self {
            rows: vertices,
            inside: points,
            held_out,
            vertices: Vec::new(),
            points: Vec::new(),
            errors: Vec::new(),
            error_products: Mat::zeros(0, 0),
        }
    }

    fn count(&self) -> usize {
        self.vertices.len() / self.rows.max(1)
    }

    fn at_vertices(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.vertices, self.rows, self.count())
    }

    fn append(&mut self, others: &Self) {
        self.vertices.extend_from_slice(&others.vertices);
        self.points.extend_from_slice(&others.points);
        self.errors.extend_from_slice(&others.errors);
        self.update_products();
    }

    fn update_products(&mut self) {
        let (count, known) = (self.count(), self.error_products.nrows());
        let errors = MatRef::from_column_major_slice(&self.errors, self.held_out, count);
        let mut new = Mat::zeros(count, count - known);
        let scale = 1.0 / self.held_out.max(1) as f64;
        matmul(
            new.as_mut(),
            Accum::Replace,
            errors.transpose(),
            errors.subcols(known, count - known),
            scale,
            Par::Seq,
        );
        let all = Mat::from_fn(count, count, |i, j| match (i < known, j < known) {
            (true, true) => self.error_products[(i, j)],
            (_, false) => new[(i, j - known)],
            (false, true) => new[(j, i - known)],
        });
        self.error_products = all;
    }

    /// Coefficients of the modes, a row for each, and what they leave of values at the vertices.
    fn expanded(&self, values: &Mat<f64>, weights: &[f64]) -> (Mat<f64>, Mat<f64>) {
        let weighted = Mat::from_fn(values.nrows(), values.ncols(), |v, k| weights[v] * values[(v, k)]);
        let mut coefficients = Mat::zeros(self.count(), values.ncols());
        matmul(
            coefficients.as_mut(),
            Accum::Replace,
            self.at_vertices().transpose(),
            &weighted,
            1.0,
            Par::Seq,
        );
        let mut rest = values.clone();
        matmul(
            rest.as_mut(),
            Accum::Add,
            self.at_vertices(),
            &coefficients,
            -1.0,
            Par::Seq,
        );
        (coefficients, rest)
    }

    /// The extension of a combination of three columns, at the points.
    fn combined(&self, coefficients: &Mat<f64>) -> Vec<Vector> {
        let modes = MatRef::from_column_major_slice(&self.points, self.inside, self.count());
        let mut values = vec![Vector::zeros(); self.inside];
        values
            .par_chunks_mut(POINTS_PER_TASK)
            .enumerate()
            .for_each(|(chunk, values)| {
                let mut sums = vec![0.0; 3 * values.len()];
                matmul(
                    MatMut::from_column_major_slice_mut(&mut sums, values.len(), 3),
                    Accum::Replace,
                    modes.subrows(chunk * POINTS_PER_TASK, values.len()),
                    coefficients,
                    1.0,
                    Par::Seq,
                );
                let rows = values.len();
                values
                    .iter_mut()
                    .enumerate()
                    .for_each(|(i, value)| *value = Vector::from_fn(|k, _| sums[k * rows + i]));
            });
        values
    }

    /// Mean square of the error of a combination of three columns at held-out points.
    fn mean_square_error(&self, coefficients: &Mat<f64>) -> f64 {
        let products = &self.error_products * coefficients;
        let entries = (0..coefficients.nrows()).flat_map(|i| (0..3).map(move |k| (i, k)));
        entries.map(|at| coefficients[at] * products[at]).sum::<f64>().max(0.0)
    }
}

/// Columns made orthonormal with weights on the rows, less those that depend on others or of which no more than `least` is left,
/// and the triangular factor of those that are kept.
fn orthonormal(columns: Mat<f64>, weights: &[f64], least: f64) -> (Mat<f64>, Mat<f64>) {
    let rows = columns.nrows();
    let product = |a: &[f64], b: &[f64]| (0..rows).map(|r| weights[r] * a[r] * b[r]).sum::<f64>();
    let mut kept: Vec<Vec<f64>> = Vec::new();
    let mut factors: Vec<Vec<f64>> = Vec::new();
    for j in 0..columns.ncols() {
        let mut column = columns.col_as_slice(j).to_vec();
        let before = product(&column, &column).sqrt();
        let mut factor = vec![0.0; columns.ncols()];
        for _ in 0..2 {
            for (i, other) in kept.iter().enumerate() {
                let along = product(other, &column);
                factor[i] += along;
                column
                    .iter_mut()
                    .zip(other)
                    .for_each(|(value, other)| *value -= along * other);
            }
        }
        let norm = product(&column, &column).sqrt();
        if norm > (DEPENDENT * before).max(least) {
            factor[kept.len()] = norm;
            column.iter_mut().for_each(|value| *value /= norm);
            kept.push(column);
            factors.push(factor);
        }
    }
    let count = kept.len();
    (
        Mat::from_fn(rows, count, |r, k| kept[k][r]),
        Mat::from_fn(count, count, |i, j| factors[j][i]),
    )
}

fn entries(matrix: &Mat<f64>) -> Vec<f64> {
    (0..matrix.ncols())
        .flat_map(|k| matrix.col_as_slice(k).to_vec())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::FitOptions;
    use crate::map::VolumeMap;
    use crate::mesh::shapes;

    fn factor() -> Arc<DomainFactor> {
        let domain = shapes::bumpy_sphere(12);
        Arc::new(DomainFactor::new(&domain, &FitOptions::default(), &|_| {}).expect("the domain is sound"))
    }

    /// Inside the bumpy sphere, some near its surface.
    fn points() -> Vec<Point> {
        let point = |i: usize| {
            let (t, r) = (i as f64, 0.6 * (i as f64 / 40.0).sqrt());
            Point::new(
                r * t.cos(),
                r * t.sin() * (0.3 * t).cos(),
                r * t.sin() * (0.3 * t).sin(),
            )
        };
        (0..40).map(point).collect()
    }

    fn bent(vertices: &[Point], by: f64, wave: f64) -> Vec<Point> {
        let image = |p: &Point| {
            Point::new(
                p.x + by * p.y * p.y,
                p.y + wave * (3.0 * p.z).sin(),
                2.0 * p.z + by * p.x,
            )
        };
        vertices.iter().map(image).collect()
    }

    /// Largest distance from the images under the map that is solved for by itself, and that map's root mean square error, over
    /// the frame's diagonal.
    fn compared(factor: &DomainFactor, images: Vec<Point>, found: &FrameImages) -> (f64, f64) {
        let boundary = BoundaryMap::new(factor.domain.clone(), images).expect("an image of each vertex");
        let fit = factor.solve(&boundary, &|_| {}).expect("the frame is sound");
        let expected = fit.map.evaluate(&points());
        let distances = expected.iter().zip(&found.images).map(|(a, b)| (a - b).norm());
        (
            distances.fold(0.0, f64::max) / boundary.target_diagonal(),
            fit.report.boundary_error.rms,
        )
    }

    #[test]
    fn combinations_of_earlier_frames_need_no_solution() {
        let factor = factor();
        let vertices = factor.domain.vertices().to_vec();
        let mut frames = FrameEvaluator::new(factor.clone(), &points(), 100).unwrap();
        let mut kept = 4;
        for (by, wave, most) in [
            (0.3, 0.0, 3),
            (0.0, 0.1, 3),
            (0.1, 0.05, 0),
            (-0.2, 0.02, 0),
            (0.0, 0.0, 0),
        ] {
            let images = bent(&vertices, by, wave);
            let found = frames.evaluate(images.clone(), &|_| {}).unwrap();
            assert!(found.solved <= most, "{by} {wave}: {found:?}");
            assert!(most == 0 || found.solved > 0);
            kept += found.solved;
            assert_eq!(frames.modes(), kept);
            let (distance, rms) = compared(&factor, images, &found);
            assert!(found.left_out < 1e-10, "{by} {wave}: {:e}", found.left_out);
            assert!(
                found.boundary_rms < 1.5 * rms + 2e-5,
                "{by} {wave}: {:e}, alone {rms:e}",
                found.boundary_rms
            );
            assert!(distance < 1e-4, "{by} {wave}: {distance:e}");
        }
    }

    /// Affine functions are harmonic, so that affine frames are exact to rounding.
    #[test]
    fn affine_frames_are_exact() {
        let factor = factor();
        let affine = |p: &Point| Point::new(2.0 * p.x + p.z + 5.0, p.y - 0.5 * p.x, 0.3 * p.z - 7.0);
        let images = factor.domain.vertices().iter().map(affine).collect();
        let found = FrameEvaluator::new(factor, &points(), 4)
            .unwrap()
            .evaluate(images, &|_| {})
            .unwrap();
        assert_eq!(found.solved, 0);
        for (image, point) in found.images.iter().zip(points()) {
            assert!((image - affine(&point)).norm() < 1e-12, "{image} {point}");
        }
    }

    /// Frames beyond the most modes are as good, and are not kept; what is left out of small motions is said.
    #[test]
    fn modes_are_bounded_and_what_is_left_out_is_reported() {
        let factor = factor();
        let vertices = factor.domain.vertices().to_vec();
        let (mut bounded, mut free) = (
            FrameEvaluator::new(factor.clone(), &points(), 5).unwrap(),
            FrameEvaluator::new(factor.clone(), &points(), 100).unwrap(),
        );
        for (by, wave) in [(0.3, 0.0), (0.1, 0.1), (0.3, 0.0)] {
            let images = bent(&vertices, by, wave);
            let (few, all) = (
                bounded.evaluate(images.clone(), &|_| {}).unwrap(),
                free.evaluate(images, &|_| {}).unwrap(),
            );
            assert!(bounded.modes() <= 5, "{}", bounded.modes());
            for (a, b) in few.images.iter().zip(&all.images) {
                assert!((a - b).norm() < 1e-4, "{a} {b}");
            }
        }
        let mut twitched = bent(&vertices, 0.3, 0.0);
        twitched[17].x += 1e-7;
        let found = free.evaluate(twitched, &|_| {}).unwrap();
        assert_eq!(found.solved, 0);
        assert!((1e-9..1e-7).contains(&found.left_out), "{:e}", found.left_out);
    }

    /// The error that is reported for a combination is that of its map, not a sum of bounds.
    #[test]
    fn the_error_is_that_of_the_combined_map() {
        let factor = factor();
        let vertices = factor.domain.vertices().to_vec();
        let mut frames = FrameEvaluator::new(factor.clone(), &points(), 100).unwrap();
        for k in 0..6 {
            frames
                .evaluate(bent(&vertices, 0.1 * f64::from(k), 0.03 * f64::from(6 - k)), &|_| {})
                .unwrap();
        }
        let images = bent(&vertices, 0.15, 0.11);
        let found = frames.evaluate(images.clone(), &|_| {}).unwrap();
        let Modes { error_products, .. } = &frames.modes;
        assert_eq!(error_products.nrows(), frames.modes());
        // The map of the same combination, by its values at the held-out points.
        let (held_out, positions) = factor.held_out.even();
        let mut at_held_out = FrameEvaluator::new(factor.clone(), positions, 100).unwrap();
        for k in 0..6 {
            at_held_out
                .evaluate(bent(&vertices, 0.1 * f64::from(k), 0.03 * f64::from(6 - k)), &|_| {})
                .unwrap();
        }
        let values = at_held_out.evaluate(images.clone(), &|_| {}).unwrap();
        let boundary = BoundaryMap::new(factor.domain.clone(), images).unwrap();
        let exact = boundary.evaluate(held_out);
        let squares = values.images.iter().zip(&exact).map(|(a, b)| (a - b).norm_squared());
        let rms = (squares.sum::<f64>() / exact.len() as f64).sqrt() / boundary.target_diagonal();
        assert!(
            (found.boundary_rms / rms - 1.0).abs() < 1e-3,
            "{:e} {rms:e}",
            found.boundary_rms
        );
    }

    #[test]
    fn unusable_frames_are_refused() {
        let factor = factor();
        let vertices = factor.domain.vertices().to_vec();
        let mut frames = FrameEvaluator::new(factor, &[], 10).unwrap();
        let fewer = frames.evaluate(vertices[1..].to_vec(), &|_| {});
        assert!(matches!(fewer, Err(FitError::BoundaryMap(_))));
        let mut broken = vertices.clone();
        broken[3].y = f64::NAN;
        assert!(matches!(
            frames.evaluate(broken, &|_| {}),
            Err(FitError::BoundaryMap(_))
        ));
        let cancelled = frames.evaluate(bent(&vertices, 0.4, 0.1), &|_| std::ops::ControlFlow::Break(()));
        assert!(matches!(cancelled, Err(FitError::Cancelled)));
        assert_eq!(frames.modes(), 4);
        assert!(frames.evaluate(vertices, &|_| {}).unwrap().images.is_empty());
    }
}
