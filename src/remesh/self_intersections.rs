//! Self-intersections of the boundary of a remeshed solid, which can occur without any inverted cell.

use super::Remeshed;
use crate::Point;
use crate::check::FindSelfIntersections;
use crate::mesh::SurfaceMesh;

/// Pairs of boundary triangles that meet in more than a corner or side common to both. Quads count as two triangles.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum BoundaryIntersections {
    /// They were looked for.
    Counted {
        /// With the nodes where the boundary map sends them.
        as_mapped: usize,
        /// With the nodes of the result.
        result: usize,
    },
    /// They could not be looked for.
    NotCounted {
        /// Why.
        reason: String,
    },
}

impl Remeshed {
    /// Counts self-intersections of the boundary. `find` finds those of a surface, as CGAL does in builds with the
    /// feature `native`.
    pub fn boundary_intersections(&self, find: Option<FindSelfIntersections>) -> BoundaryIntersections {
        let Some(find) = find else {
            let reason = "it needs CGAL, which this build does not have".into();
            return BoundaryIntersections::NotCounted { reason };
        };
        let pairs = |positions: &[Point], boundary: &[[u32; 3]]| {
            let surface = SurfaceMesh::new(positions.to_vec(), boundary.to_vec());
            find(&surface.map_err(|error| error.to_string())?).map(|pairs| pairs.len())
        };
        let count = || {
            let boundary = self.mesh.boundary();
            let as_mapped = pairs(&self.carried, self.unsplit_boundary.as_deref().unwrap_or(boundary))?;
            let result = if self.report.slid_nodes > 0 || self.unsplit_boundary.is_some() {
                pairs(&self.images, boundary)?
            } else {
                as_mapped
            };
            Ok(BoundaryIntersections::Counted { as_mapped, result })
        };
        count().unwrap_or_else(|reason| BoundaryIntersections::NotCounted { reason })
    }
}

impl BoundaryIntersections {
    /// Whether the boundary of the result is known to pass through itself.
    pub fn found(&self) -> bool {
        matches!(self, Self::Counted { result, .. } if *result > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CellKind, CellSize, RemeshOptions, RemeshSource, remesh};
    use super::*;
    use crate::Matrix3;
    use crate::boundary_map::BoundaryMap;
    use crate::map::VolumeMap;
    use crate::mesh::shapes;

    struct Identity;

    impl VolumeMap for Identity {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            points.to_vec()
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            vec![Matrix3::identity(); points.len()]
        }
    }

    #[test]
    fn intersections_are_counted_as_mapped_and_again_where_nodes_slid() {
        let cube = shapes::cube(2.0, 2);
        let boundary = BoundaryMap::new(cube.clone(), cube.vertices().to_vec()).unwrap();
        let source = RemeshSource::Regular {
            kind: CellKind::Tets,
            size: CellSize::Along(2),
            most_cells: 1000,
        };
        let mut remeshed = remesh(&boundary, &Identity, source, &RemeshOptions::default(), &|_| {}).unwrap();
        // A number of pairs that depends on the node positions.
        let find = |surface: &SurfaceMesh| Ok(vec![[0, 1]; surface.volume().abs().round() as usize]);
        let counted = |as_mapped, result| BoundaryIntersections::Counted { as_mapped, result };
        remeshed.images.iter_mut().for_each(|p| *p *= 0.5);
        assert_eq!(remeshed.boundary_intersections(Some(&find)), counted(8, 8));
        remeshed.report.slid_nodes = 1;
        assert_eq!(remeshed.boundary_intersections(Some(&find)), counted(8, 1));
        let fails = |_: &SurfaceMesh| Err("too many triangles".into());
        let reason = "too many triangles".to_string();
        assert_eq!(
            remeshed.boundary_intersections(Some(&fails)),
            BoundaryIntersections::NotCounted { reason }
        );
        assert!(!remeshed.boundary_intersections(None).found());
    }
}
