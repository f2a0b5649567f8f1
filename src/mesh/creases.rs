//! Sharp edges of a surface, and the curves that they form.

use std::collections::{BTreeMap, HashMap};

use super::SurfaceMesh;
use super::topology::DisjointSets;
use crate::Vector;

/// The angle in degrees between the normals beside an edge from which it counts as a feature where nothing else is said. At 45 it would be
/// left to rounding whether the edges of a bevel do.
pub(crate) const FEATURE_ANGLE: f64 = 40.0;

/// Edges, by their ends in ascending order, with an angle between the normals beside them of a smaller cosine than this, or with
/// other than two triangles. Ascending.
pub fn creases(surface: &SurfaceMesh, cosine: f64) -> Vec<[u32; 2]> {
    let normal = |t: usize| surface.area_vector(t).try_normalize(0.0).unwrap_or_else(Vector::zeros);
    let normals: Vec<Vector> = (0..surface.triangles().len()).map(normal).collect();
    let mut beside: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
    for (index, &[a, b, c]) in surface.triangles().iter().enumerate() {
        for [p, q] in [[a, b], [b, c], [c, a]] {
            beside.entry([p.min(q), p.max(q)]).or_default().push(index);
        }
    }
    let is_crease = |beside: &[usize]| match beside {
        [a, b] => normals[*a].dot(&normals[*b]) < cosine,
        _ => true,
    };
    beside.retain(|_, beside| is_crease(beside));
    beside.into_keys().collect()
}

/// The creases that are connected, end nowhere, and are at least `least_length` long together: feature curves, not noise of a
/// scanned surface.
pub fn feature_curves(surface: &SurfaceMesh, creases: &[[u32; 2]], least_length: f64) -> Vec<[u32; 2]> {
    let mut edges = creases.to_vec();
    let mut at: HashMap<u32, usize> = HashMap::new();
    edges
        .as_flattened()
        .iter()
        .for_each(|v| *at.entry(*v).or_default() += 1);
    // Ends are taken away until there are none.
    loop {
        let before = edges.len();
        edges.retain(|ends| {
            let stays = ends.iter().all(|v| at[v] > 1);
            if !stays {
                ends.iter().for_each(|v| *at.entry(*v).or_default() -= 1);
            }
            stays
        });
        if edges.len() == before {
            break;
        }
    }
    let mut curves = DisjointSets::new(surface.vertices().len());
    edges.iter().for_each(|&[a, b]| curves.unite(a, b));
    let mut lengths: HashMap<u32, f64> = HashMap::new();
    for ends in &edges {
        let [p, q] = ends.map(|v| surface.vertices()[v as usize]);
        *lengths.entry(curves.find(ends[0])).or_default() += (q - p).norm();
    }
    edges.retain(|[a, _]| lengths[&curves.find(*a)] >= least_length);
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_cube_has_twelve_and_a_sphere_none() {
        let cube = shapes::cube(2.0, 4);
        let found = creases(&cube, 0.7);
        // Twelve edges of four parts each.
        assert_eq!(found.len(), 48);
        assert_eq!(feature_curves(&cube, &found, 23.9), found);
        assert!(feature_curves(&cube, &found, 24.1).is_empty());
        assert!(creases(&shapes::sphere(1.0, 4), 0.7).is_empty());
    }

    #[test]
    fn what_ends_somewhere_is_no_curve() {
        let cube = shapes::cube(2.0, 4);
        let mut found = creases(&cube, 0.7);
        // A gap: the other edges of the cube still form closed curves.
        let gone = found.pop().unwrap();
        let curves = feature_curves(&cube, &found, 0.0);
        assert_eq!(curves.len(), 44);
        assert!(!curves.contains(&gone));
        // A path of three edges ends at both ends.
        assert!(feature_curves(&cube, &[found[0], found[1]], 0.0).is_empty());
    }
}
