//! The map by conformal spheres, turned onto each other by the rotation that fits best.

use super::inter_surface::InverseEmbedding;
use super::{PairError, PairMapping, PairMaps, PairMethod, PairPhase, PairReport, PairTimings, search_rotations};
use crate::geometry::sphere_rotation;
use crate::spherical::{Locator, Moebius, SphereEnergy, SphericalEmbedding, check_embedding};
use crate::{Matrix3, Vector};

/// A warning says that the rotation is ambiguous when the second best score is this close to the best.
const AMBIGUOUS_SCORE: f64 = 0.05;

impl PairMapping<'_> {
    pub(super) fn by_conformal_maps(&self) -> Result<PairMaps, PairError> {
        let domain = self.sphere("domain", self.domain, SphereEnergy::Conformal)?;
        let target = self.sphere("target", self.target, SphereEnergy::Conformal)?;
        let sphere = self.elapsed();

        self.report(PairPhase::Aligning { done: 0, of: 0 })?;
        let mut warnings = Vec::new();
        let matches = search_rotations(&domain, &target, None);
        let rotations: Vec<f64> = matches.iter().map(|found| found.score).collect();
        if let [best, second, ..] = rotations[..]
            && second > best - AMBIGUOUS_SCORE
            && self.landmarks.pairs().len() < 2
        {
            warnings.push(
                "several rotations of the spheres fit nearly as well; give landmarks if the map goes to the wrong place"
                    .into(),
            );
        }
        let turned = self.by_three_landmarks(&domain, &target).unwrap_or_else(|| {
            let by_landmarks = self.rotation_of_landmarks(&domain, &target, &mut warnings);
            let rotation = by_landmarks.or(matches.first().map(|found| found.rotation));
            let rotation = rotation.unwrap_or_else(Matrix3::identity);
            domain.directions().iter().map(|x| (rotation * x).normalize()).collect()
        });
        // Rotating may invert the smallest triangles by rounding. Then the target is rotated instead.
        let (turned, target) = if check_embedding(self.domain.triangles(), &turned).is_bijective() {
            (turned, target)
        } else {
            let back = sphere_rotation(&turned, domain.directions(), &vec![1.0; turned.len()]);
            let back = back.map_or_else(Matrix3::identity, |back| back.rotation);
            let directions: Vec<Vector> = target.directions().iter().map(|x| back * x).collect();
            let turned_target = SphericalEmbedding::new(target.surface().clone(), &directions);
            let error = |error| PairError::Sphere { side: "target", error };
            (domain.directions().to_vec(), turned_target.map_err(error)?)
        };
        let align = self.elapsed();

        self.improving(0);
        let locator = Locator::new(&target);
        let inverse = InverseEmbedding::new(&target, &locator);
        let embedder = self.embedder(&target, &inverse)?;
        let mut after = embedder.candidate_at(&turned);
        let before = after.clone();
        if self.options.improve {
            embedder.finish(&mut after, &|rounds| self.improving(rounds));
        }
        self.require_landmarks(&after)?;
        let (improved, concluded) = (self.elapsed(), self.reporter.should_conclude());
        let (map, distortions, stretch) = self.measured(&target, &before, &after)?;
        let report = PairReport {
            landmarks: self.landmarks.pairs().len(),
            landmark_error: self.landmark_error(&map),
            rotations,
            timings: PairTimings {
                sphere,
                align: align - sphere,
                improve: improved - align,
                total: self.elapsed(),
                ..PairTimings::default()
            },
            concluded,
            warnings,
            ..PairReport::of(PairMethod::Conformal, distortions, stretch)
        };
        Ok(PairMaps {
            map,
            report,
            alternatives: vec![],
        })
    }

    /// The domain's directions under the Möbius transformation that meets the first three landmarks; `None` if that
    /// inverts a geodesic triangle.
    fn by_three_landmarks(&self, domain: &SphericalEmbedding, target: &SphericalEmbedding) -> Option<Vec<Vector>> {
        let three = self.landmarks.pairs().first_chunk::<3>()?;
        let from = three.map(|[v, _]| domain.directions()[v as usize]);
        let to = three.map(|[_, w]| target.directions()[w as usize]);
        let moebius = Moebius::of_three(&from, &to)?;
        let moved: Vec<Vector> = domain.directions().iter().map(|x| moebius.apply(x)).collect();
        let is_bijective = check_embedding(self.domain.triangles(), &moved).is_bijective();
        is_bijective.then_some(moved)
    }

    fn rotation_of_landmarks(
        &self,
        domain: &SphericalEmbedding,
        target: &SphericalEmbedding,
        warnings: &mut Vec<String>,
    ) -> Option<Matrix3> {
        let pairs = self.landmarks.pairs();
        if pairs.len() < 2 {
            return None;
        }
        let directions = |&[v, w]: &[u32; 2]| (domain.directions()[v as usize], target.directions()[w as usize]);
        let (from, to): (Vec<Vector>, Vec<Vector>) = pairs.iter().map(directions).unzip();
        let turn = sphere_rotation(&from, &to, &vec![1.0; from.len()])?;
        if pairs.len() > 3 && turn.mirrored_residual < 0.5 * turn.residual {
            warnings.push("the landmarks have the opposite cyclic order on the target, as on a mirror image".into());
        }
        Some(turn.rotation)
    }
}
