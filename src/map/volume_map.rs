use crate::{Matrix3, Point};

/// A map of a solid into space: the harmonic map of this crate, a rival, or a formula.
///
/// Energies, remeshing and transfer see maps through this trait only, so that every method is measured alike. All
/// functions take many points at once, because an implementation that sums over sources or walks a mesh is then free
/// to order and share its work. Points outside the domain are the implementation's affair: it answers with whatever
/// its formula gives there, NaN where it has none.
pub trait VolumeMap: Sync {
    /// Images of the points, in order.
    fn evaluate(&self, points: &[Point]) -> Vec<Point>;

    /// Jacobians `J[(i, k)] = ∂f_i / ∂x_k` at the points, in order.
    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3>;

    /// Both at once, for implementations that find them together for less than one after the other.
    fn evaluate_with_jacobian(&self, points: &[Point]) -> (Vec<Point>, Vec<Matrix3>) {
        (self.evaluate(points), self.jacobian(points))
    }
}
