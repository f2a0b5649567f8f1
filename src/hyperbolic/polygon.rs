//! A surface group as isometries of the hyperbolic plane: the side pairings of a regular polygon.
//!
//! A surface of genus `g`, cut along `2g` loops through one vertex, is a polygon with `4g` sides. With sides of equal length and
//! angles of `π/2g` the copies of the polygon fill the hyperbolic plane, whatever sides are paired (Poincaré's theorem: de Rham,
//! *Sur les polygones générateurs de groupes fuchsiens*, 1971).

use std::sync::Arc;

use super::minkowski::{boost, product, rotation};
use super::word::{Letter, Relator, Word};
use crate::{Matrix3, Vector};

/// A surface group with its polygon, which is centred at `(0, 0, 1)`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SurfaceGroup {
    pub relator: Arc<Relator>,
    /// By side, counter-clockwise: the letter of the polygon on its other side.
    sides: Vec<Letter>,
    /// By side, the isometry of that letter.
    pairings: Vec<Matrix3>,
    /// By letter, shifted by the number of generators.
    side_of: Vec<usize>,
}

/// Points this much nearer to the centre of another polygon are moved, so that rounding does not move them to and fro.
const NEARER: f64 = 1e-9;

impl SurfaceGroup {
    /// The group with this relator: the letters of the polygons around a corner, counter-clockwise. `None` where the sides do not
    /// close to one polygon, and those of [`Relator::new`].
    pub fn new(letters: &[Letter]) -> Option<Self> {
        let relator = Relator::new(letters)?;
        let (count, generators) = (letters.len(), relator.generators());
        let place = |letter: Letter| (i64::from(letter) + generators as i64) as usize;
        // Around a corner one leaves each polygon through the side that ends there, and enters the next through that which
        // begins there.
        let mut next = vec![0; 2 * generators + 1];
        for (&entered, &left) in letters.iter().zip(letters.iter().cycle().skip(1)) {
            next[place(left)] = -entered;
        }
        let mut sides = vec![1 as Letter];
        while sides.len() < count {
            sides.push(next[place(sides[sides.len() - 1])]);
        }
        let mut side_of = vec![usize::MAX; 2 * generators + 1];
        for (side, &letter) in sides.iter().enumerate() {
            side_of[place(letter)] = side;
        }
        let is_one = |letter: &Letter| side_of[place(*letter)] != usize::MAX;
        if !letters.iter().all(is_one) {
            return None;
        }
        let turn = std::f64::consts::TAU / count as f64;
        let to_side = 1.0 / (0.5 * turn).tan();
        let across = boost(2.0 * to_side * to_side - 1.0);
        let of_side = |(side, letter): (usize, &Letter)| {
            let partner = side_of[place(-letter)];
            let [own, other] = [side, partner].map(|side| turn * side as f64);
            rotation(own) * across * rotation(std::f64::consts::PI - other)
        };
        let pairings = sides.iter().enumerate().map(of_side).collect();
        Some(Self {
            relator: Arc::new(relator),
            sides,
            pairings,
            side_of,
        })
    }

    pub fn genus(&self) -> usize {
        self.sides.len() / 4
    }

    /// The area of the surface: that of the polygon, `4π(g − 1)`.
    pub fn area(&self) -> f64 {
        4.0 * std::f64::consts::PI * (self.genus() as f64 - 1.0)
    }

    /// The corners of the polygon, counter-clockwise, side `k` from corner `k` on.
    pub fn corners(&self) -> Vec<Vector> {
        let turn = std::f64::consts::TAU / self.sides.len() as f64;
        let cotangent = 1.0 / (0.5 * turn).tan();
        let corner = |k: usize| rotation(turn * (k as f64 - 0.5)) * boost(cotangent * cotangent) * Vector::z();
        (0..self.sides.len()).map(corner).collect()
    }

    /// The letters of the sides, counter-clockwise.
    #[cfg(test)]
    pub fn sides(&self) -> &[Letter] {
        &self.sides
    }

    fn pairing(&self, letter: Letter) -> &Matrix3 {
        &self.pairings[self.side_of[(i64::from(letter) + self.relator.generators() as i64) as usize]]
    }

    /// The isometry of a word, applied to a point.
    pub fn moved(&self, word: &Word, x: &Vector) -> Vector {
        word.0.iter().rev().fold(*x, |x, &letter| self.pairing(letter) * x)
    }

    pub fn matrix(&self, word: &Word) -> Matrix3 {
        let letters = word.0.iter();
        letters.fold(Matrix3::identity(), |m, &letter| m * self.pairing(letter))
    }

    /// The copy of a point nearest to the centre, in the polygon, and the word that takes the point there.
    pub fn in_polygon(&self, x: &Vector) -> (Vector, Word) {
        let (mut x, mut word) = (*x, Word::default());
        loop {
            // The letter whose polygon the point is in, or toward which.
            let nearness = |side: usize| product(&x, &self.pairings[side].column(2).into());
            let best = (0..self.sides.len()).max_by(|&a, &b| nearness(a).total_cmp(&nearness(b)));
            let Some(side) = best.filter(|&side| nearness(side) > -x.z * (1.0 - NEARER)) else {
                return (x, self.relator.shortened(word));
            };
            let back = -self.sides[side];
            x = super::minkowski::lifted((self.pairing(back) * x).xy().into());
            word = Word::letter(back).times(&word);
        }
    }
}

/// The group of the double torus, for tests: sides `a b a⁻¹ b⁻¹ c d c⁻¹ d⁻¹`, or the like of it.
#[cfg(test)]
pub(crate) fn standard(genus: i8) -> SurfaceGroup {
    let of_handle = |k: i8| {
        let (a, b) = (2 * k + 1, 2 * k + 2);
        [a, b, -a, -b]
    };
    SurfaceGroup::new(&(0..genus).flat_map(of_handle).collect::<Vec<_>>()).unwrap()
}

#[cfg(test)]
mod tests {
    use super::super::minkowski::lifted;
    use super::*;

    #[test]
    fn the_relator_is_the_identity_and_sides_are_paired() {
        for genus in [2, 3, 4, 9] {
            let group = standard(genus);
            let whole = group.matrix(&Word(group.relator.letters().into()));
            // Products of matrices of size cosh.
            let size = group.corners()[0].z.powi(2);
            assert!(
                (whole - Matrix3::identity()).norm() < 1e-11 * size * size,
                "{genus}: {}",
                (whole - Matrix3::identity()).norm()
            );
            let corners = group.corners();
            for (side, &letter) in group.sides().iter().enumerate() {
                let partner = group.sides().iter().position(|&other| other == -letter).unwrap();
                let image = group.moved(&Word::letter(letter), &corners[partner]);
                let expected = corners[(side + 1) % corners.len()];
                assert!((image - expected).norm() < 1e-9 * size * size, "{genus}");
            }
        }
    }

    #[test]
    fn points_are_moved_into_the_polygon_and_back() {
        let group = standard(2);
        for (x, y) in [(0.1, 0.2), (30.0, -4.0), (-500.0, 700.0)] {
            let far = lifted([x, y]);
            let (near, word) = group.in_polygon(&far);
            assert!(near.z < group.corners()[0].z * (1.0 + 1e-9));
            let back = group.moved(&word.inverted(), &near);
            assert!((back - far).norm() < 1e-7 * far.norm(), "{back} {far}");
        }
    }
}
