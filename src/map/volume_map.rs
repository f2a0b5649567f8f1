use crate::{Matrix3, Point};

/// A map of a solid into space: the harmonic map of this crate, one by a method it is compared with, or a formula.
///
/// Energies, remeshing and transfer use maps through this trait only, so that all methods are measured alike. Functions
/// take many points at once, so that an implementation that sums over sources or walks a mesh can order and share its
/// work. Images of points outside the domain are left to the implementation; they may be NaN.
pub trait VolumeMap: Sync {
    /// Images of the points, in order.
    fn evaluate(&self, points: &[Point]) -> Vec<Point>;

    /// Jacobians `J[(i, k)] = ∂f_i / ∂x_k` at the points, in order.
    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3>;

    /// Both at once, which some implementations compute faster than one after the other.
    fn evaluate_with_jacobian(&self, points: &[Point]) -> (Vec<Point>, Vec<Matrix3>) {
        (self.evaluate(points), self.jacobian(points))
    }
}
