//! Drags a vertex of an embedding to a direction, and what lies around it with it.
//!
//! A vertex alone is soon stopped by the triangles on its way. Moved by a smooth field, which is the displacement of the vertex
//! there and nothing beyond a radius, triangles keep their orientation but for slivers, as long as the displacement is small
//! beside the radius: on the sphere, one point can always be pushed to another without moving a third.

use crate::Vector;
use crate::spherical::PartialEmbedding;

/// The largest displacement in one step, as a fraction of the radius. The field (1 - r²)² falls by at most 1.54 per radius, so
/// that it takes points past each other from 0.65 on.
const MOST_DISPLACED: f64 = 0.3;
/// How often the displacement is halved where triangles would be inverted.
const MOST_HALVINGS: usize = 12;

/// What a step has moved.
pub(super) struct Dragged {
    /// The vertices, that which was dragged among them.
    pub moved: Vec<u32>,
    /// Whether it has come to its direction.
    pub arrived: bool,
}

/// Moves an embedded vertex towards `to`, as far as possible, with the vertices nearer than `radius` to it. All triangles stay
/// positive. `None` where it can hardly move.
pub(super) fn drag(embedding: &mut PartialEmbedding, vertex: u32, to: &Vector, radius: f64) -> Option<Dragged> {
    let from = embedding.directions[vertex as usize];
    let displacement = to - from;
    let around = embedding.inserted.iter().filter_map(|&v| {
        let x = embedding.directions[v as usize];
        let r = (x - from).norm() / radius;
        (r < 1.0).then(|| (v, x, (1.0 - r * r).powi(2)))
    });
    let around: Vec<(u32, Vector, f64)> = around.collect();
    let mut share = (MOST_DISPLACED * radius / displacement.norm()).min(1.0);
    for _ in 0..MOST_HALVINGS {
        for (v, x, weight) in &around {
            embedding.directions[*v as usize] = (x + share * weight * displacement).normalize();
        }
        let arrived = share == 1.0;
        if arrived {
            embedding.directions[vertex as usize] = *to;
        }
        let is_positive = |(v, ..): &(u32, Vector, f64)| {
            let x = embedding.directions[*v as usize];
            embedding.stays_positive(*v, &x)
        };
        if around.iter().all(is_positive) {
            let moved = around.iter().map(|(v, ..)| *v).collect();
            return Some(Dragged { moved, arrived });
        }
        share *= 0.5;
    }
    for (v, x, _) in around {
        embedding.directions[v as usize] = x;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{SurfaceMesh, shapes};
    use crate::spherical::check_embedding;

    fn embedded(sphere: &SurfaceMesh) -> PartialEmbedding {
        let directions: Vec<Vector> = sphere.vertices().iter().map(|p| p.coords).collect();
        PartialEmbedding::complete(sphere, &directions)
    }

    fn is_bijective(sphere: &SurfaceMesh, embedding: &PartialEmbedding) -> bool {
        check_embedding(sphere.triangles(), &embedding.directions).is_bijective()
    }

    #[test]
    fn a_vertex_takes_what_lies_around_it_along_and_leaves_the_rest() {
        let sphere = shapes::sphere(1.0, 4);
        let mut embedding = embedded(&sphere);
        let from = embedding.directions[17];
        let to = (from + 0.15 * from.cross(&Vector::new(0.3, 0.2, -0.9)).normalize()).normalize();
        assert!(!embedding.stays_positive(17, &to), "alone it is stopped");
        let before = embedding.directions.clone();
        let dragged = drag(&mut embedding, 17, &to, 0.6).unwrap();
        assert!(dragged.arrived && embedding.directions[17] == to);
        assert!(is_bijective(&sphere, &embedding));
        for (v, (before, after)) in before.iter().zip(&embedding.directions).enumerate() {
            let is_near = (before - from).norm() < 0.6;
            assert_eq!(is_near, dragged.moved.contains(&(v as u32)));
            assert!(is_near || before == after);
        }
    }

    /// Half way round the sphere, past a hundred other vertices.
    #[test]
    fn the_way_is_made_in_steps_and_no_triangle_is_inverted() {
        let sphere = shapes::sphere(1.0, 4);
        let mut embedding = embedded(&sphere);
        let to = -(embedding.directions[17] + Vector::new(0.1, 0.2, 0.05)).normalize();
        let mut steps = 0;
        while let Some(dragged) = drag(&mut embedding, 17, &to, 0.5) {
            steps += 1;
            assert!(is_bijective(&sphere, &embedding), "step {steps}");
            if dragged.arrived || steps == 8 {
                break;
            }
        }
        // 0.15 each, as long as nothing is squeezed flat before it.
        assert!(steps >= 4, "{steps}");
    }

    #[test]
    fn where_nothing_can_move_all_stays() {
        let sphere = shapes::sphere(1.0, 3);
        let mut embedding = embedded(&sphere);
        let before = embedding.directions.clone();
        // The neighbour's place, with a radius in which there is no other vertex.
        let neighbour = embedding.directions[embedding.rings.of(5)[0] as usize];
        let mut moved = 0.0;
        while let Some(dragged) = drag(&mut embedding, 5, &neighbour, 1e-3) {
            assert!(!dragged.arrived && dragged.moved == [5]);
            moved += 1.0;
            if moved > 3.0 {
                break;
            }
        }
        let others = |v: &usize| *v != 5;
        assert!(
            (0..before.len())
                .filter(others)
                .all(|v| before[v] == embedding.directions[v])
        );
        assert!((embedding.directions[5] - before[5]).norm() < 4.1 * 0.3e-3);
        assert!(is_bijective(&sphere, &embedding));
    }
}
