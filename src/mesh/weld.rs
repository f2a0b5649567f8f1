use rayon::prelude::*;

use super::SurfaceMesh;
use crate::Point;

/// For each vertex the lowest one at exactly the same place: itself when it is the first or only one there.
pub fn lowest_coincident_vertices(vertices: &[Point]) -> Vec<u32> {
    // Adding zero makes -0 and 0 one place.
    let place = |v: u32| vertices[v as usize].coords.map(|x| x + 0.0);
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.par_sort_unstable_by(|&a, &b| {
        let (p, q) = (place(a), place(b));
        let coordinates = p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z));
        coordinates.then(a.cmp(&b))
    });
    let mut lowest: Vec<u32> = (0..vertices.len() as u32).collect();
    for pair in order.windows(2) {
        if place(pair[0]) == place(pair[1]) {
            lowest[pair[1] as usize] = lowest[pair[0] as usize];
        }
    }
    lowest
}

/// The same surface with coincident vertices joined: triangles refer to the lowest vertex at each place. The other
/// vertices stay in the array, unused.
pub fn welded(mesh: &SurfaceMesh) -> SurfaceMesh {
    let lowest = lowest_coincident_vertices(mesh.vertices());
    let triangles = mesh.triangles().iter().map(|t| t.map(|v| lowest[v as usize]));
    SurfaceMesh::new(mesh.vertices().to_vec(), triangles.collect()).expect("welding names vertices that are there")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_place_has_its_lowest_vertex() {
        let at = |x: f64, y: f64| Point::new(x, y, 1.0);
        let vertices = [
            at(0.0, 5.0),
            at(1.0, 1.0),
            at(-0.0, 2.0),
            at(0.0, 2.0),
            at(-0.0, 5.0),
            at(f64::NAN, 0.0),
            at(f64::NAN, 0.0),
        ];
        assert_eq!(lowest_coincident_vertices(&vertices), [0, 1, 2, 2, 0, 5, 6]);
        let mesh = SurfaceMesh::new(vertices.to_vec(), vec![[4, 3, 1]]).unwrap();
        assert_eq!(welded(&mesh).triangles(), [[0, 2, 1]]);
    }
}
