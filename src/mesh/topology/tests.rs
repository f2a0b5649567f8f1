use super::*;
use crate::Point;
use crate::mesh::shapes;

#[test]
fn every_edge_of_a_closed_manifold_has_two_sides_in_opposite_directions() {
    let mesh = shapes::torus(1.0, 0.3, 12, 7);
    let topology = Topology::new(&mesh);
    assert_eq!(topology.edges().len(), 3 * mesh.triangles().len() / 2);
    for (edge, &[u, v]) in topology.edges().iter().enumerate() {
        let sides = topology.sides(edge);
        assert_eq!(sides.len(), 2);
        let mut starts = [topology.start(sides[0]), topology.start(sides[1])];
        starts.sort_unstable();
        assert_eq!(starts, [u, v]);
        for side in sides {
            let edges = topology.edges_of_triangle(side.triangle as usize).unwrap();
            assert_eq!(edges[side.corner as usize] as usize, edge);
        }
    }
    assert!(topology.is_closed() && topology.is_edge_manifold());
    assert!(topology.non_manifold_vertices().is_empty() && topology.unreferenced_vertices().is_empty());
    assert!(topology.boundary_loops().is_empty());
}

#[test]
fn genus_counts_the_handles() {
    for (mesh, genus) in [
        (shapes::sphere(1.0, 2), 0),
        (shapes::torus(1.0, 0.3, 9, 8), 1),
        (shapes::double_torus(2), 2),
        (shapes::cube(1.0, 3), 0),
    ] {
        let components = Topology::new(&mesh).components();
        assert_eq!(components.shapes.len(), 1);
        assert_eq!(components.shapes[0].genus(), Some(genus));
        assert_eq!(components.shapes[0].euler_characteristic(), 2 - 2 * genus as i64);
        assert_eq!(components.shapes[0].vertices, mesh.vertices().len());
    }
}

#[test]
fn components_are_numbered_by_their_lowest_triangle() {
    let two = shapes::joined(&shapes::torus(1.0, 0.3, 6, 5), &shapes::sphere(1.0, 0));
    let mut triangles = two.triangles().to_vec();
    triangles.rotate_right(20);
    let mesh = SurfaceMesh::new(two.vertices().to_vec(), triangles).unwrap();
    let components = Topology::new(&mesh).components();
    assert!(components.of_triangle[..20].iter().all(|&c| c == 0));
    assert!(components.of_triangle[20..].iter().all(|&c| c == 1));
    assert_eq!(components.shapes[0].genus(), Some(0));
    assert_eq!(components.shapes[1].genus(), Some(1));
}

#[test]
fn removing_the_star_of_a_vertex_leaves_one_hole_bounded_by_its_link() {
    let whole = shapes::sphere(1.0, 1);
    let gone = 17;
    let mesh = without_triangles(&whole, |t| t.contains(&gone));
    let topology = Topology::new(&mesh);
    assert!(!topology.is_closed());
    assert_eq!(topology.unreferenced_vertices(), [gone]);
    let loops = topology.boundary_loops();
    assert_eq!(loops.len(), 1);
    assert_eq!(loops[0].len(), topology.open_edges().len());
    // A fan from the removed vertex over the rim is what was taken away.
    let mut closed = mesh.triangles().to_vec();
    for (i, &v) in loops[0].iter().enumerate() {
        closed.push([gone, v, loops[0][(i + 1) % loops[0].len()]]);
    }
    let closed = SurfaceMesh::new(mesh.vertices().to_vec(), closed).unwrap();
    let topology = Topology::new(&closed);
    assert!(topology.is_closed() && topology.orientation().inconsistent_edges.is_empty());
    assert!((closed.volume() - whole.volume()).abs() < 1e-12 * whole.volume());
}

#[test]
fn rims_pass_straight_through_a_vertex_where_holes_touch() {
    // Opposite quarters of a disc of eight triangles: one vertex with two open fans, each with its own rim.
    let mut vertices = vec![Point::origin()];
    vertices.extend(
        (0..8)
            .map(|i| (f64::from(i) * std::f64::consts::FRAC_PI_4).sin_cos())
            .map(|(s, c)| Point::new(c, s, 0.0)),
    );
    let mesh = SurfaceMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3], [0, 5, 6], [0, 6, 7]]).unwrap();
    let topology = Topology::new(&mesh);
    assert_eq!(topology.non_manifold_vertices(), [0]);
    let mut loops = topology.boundary_loops();
    loops.iter_mut().for_each(|rim| rim.sort_unstable());
    assert_eq!(loops, [vec![0, 1, 2, 3], vec![0, 5, 6, 7]]);
    assert_eq!(topology.components().shapes.len(), 2);
}

#[test]
fn balls_that_touch_in_a_vertex_are_two_components_and_a_pinch() {
    let mesh = pinched_balls();
    let topology = Topology::new(&mesh);
    assert!(topology.is_closed() && topology.is_edge_manifold());
    assert_eq!(topology.non_manifold_vertices(), [0]);
    let shapes = topology.components().shapes;
    assert_eq!(
        shapes.iter().map(ComponentShape::genus).collect::<Vec<_>>(),
        [Some(0), Some(0)]
    );
}

#[test]
fn three_triangles_on_an_edge_are_not_manifold() {
    let vertices = (0..5)
        .map(|i| Point::new(f64::from(i), f64::from(i * i), 1.0))
        .collect();
    let mesh = SurfaceMesh::new(vertices, vec![[0, 2, 4], [3, 2, 4], [2, 4, 1]]).unwrap();
    let topology = Topology::new(&mesh);
    assert_eq!(topology.non_manifold_edges(), [[2, 4]]);
    assert_eq!(topology.open_edges().len(), 6);
    assert!(topology.non_manifold_vertices().is_empty());
    let components = topology.components();
    assert_eq!(components.shapes.len(), 1);
    assert!(!components.shapes[0].manifold);
    assert_eq!(components.shapes[0].genus(), None);
    // Two of the three lie on one loop; the walk of the third ends where no open edge is left.
    let mut rims: Vec<usize> = topology.boundary_loops().iter().map(Vec::len).collect();
    rims.sort_unstable();
    assert_eq!(rims, [3, 4]);
}

#[test]
fn orientation_flips_the_minority_back() {
    let whole = shapes::sphere(1.0, 2);
    for wrong in [vec![3], vec![0, 1, 77], (0..200).collect::<Vec<_>>()] {
        let mut triangles = whole.triangles().to_vec();
        wrong.iter().for_each(|&t: &usize| triangles[t].swap(1, 2));
        let mesh = SurfaceMesh::new(whole.vertices().to_vec(), triangles).unwrap();
        let orientation = Topology::new(&mesh).orientation();
        assert!(!orientation.inconsistent_edges.is_empty() && orientation.twisted_edges.is_empty());
        let minority = wrong.len() < whole.triangles().len() / 2;
        for t in 0..whole.triangles().len() {
            assert_eq!(orientation.flip[t], wrong.contains(&t) == minority);
        }
    }
}

#[test]
fn a_moebius_strip_is_not_orientable_and_has_one_rim() {
    let mesh = moebius(20);
    let topology = Topology::new(&mesh);
    let orientation = topology.orientation();
    assert_eq!(orientation.twisted_edges.len(), 1);
    assert!(orientation.flip.iter().all(|flip| !flip));
    assert_eq!(topology.boundary_loops().len(), 1);
    assert_eq!(topology.components().shapes[0].euler_characteristic(), 0);
}

#[test]
fn triangles_that_name_a_vertex_twice_take_no_part() {
    let sphere = shapes::sphere(1.0, 0);
    let mut triangles = sphere.triangles().to_vec();
    triangles.insert(4, [0, 0, 5]);
    let mesh = SurfaceMesh::new(sphere.vertices().to_vec(), triangles).unwrap();
    let topology = Topology::new(&mesh);
    assert!(topology.is_closed() && topology.is_edge_manifold());
    assert_eq!(topology.edges_of_triangle(4), None);
    let components = topology.components();
    assert_eq!(components.of_triangle[4], NONE);
    assert_eq!(components.shapes[0].genus(), Some(0));
}

#[test]
fn an_empty_mesh_has_no_parts_and_is_not_closed() {
    let mesh = SurfaceMesh::default();
    let topology = Topology::new(&mesh);
    assert!(!topology.is_closed() && topology.edges().is_empty());
    assert!(topology.components().shapes.is_empty() && topology.boundary_loops().is_empty());
}

fn without_triangles(mesh: &SurfaceMesh, gone: impl Fn(&[u32; 3]) -> bool) -> SurfaceMesh {
    let kept = mesh.triangles().iter().copied().filter(|t| !gone(t)).collect();
    SurfaceMesh::new(mesh.vertices().to_vec(), kept).unwrap()
}

fn pinched_balls() -> SurfaceMesh {
    let ball = shapes::sphere(1.0, 1);
    let shift = ball.vertices()[0].coords * 2.0;
    let other = shapes::deformed(&ball, |p| Point::from(shift - p.coords));
    let two = shapes::joined(&ball, &other.reversed());
    let doubled = ball.vertices().len() as u32;
    let triangles = two
        .triangles()
        .iter()
        .map(|t| t.map(|v| if v == doubled { 0 } else { v }));
    SurfaceMesh::new(two.vertices().to_vec(), triangles.collect()).unwrap()
}

fn moebius(n: u32) -> SurfaceMesh {
    let vertices = (0..n)
        .flat_map(|i| [-0.3, 0.3].map(|s| (std::f64::consts::TAU * f64::from(i) / f64::from(n), s)))
        .map(|(u, s): (f64, f64)| {
            let r = 1.0 + s * (u / 2.0).cos();
            Point::new(r * u.cos(), r * u.sin(), s * (u / 2.0).sin())
        })
        .collect();
    let at = |i: u32, side: u32| if i < n { 2 * i + side } else { 1 - side };
    let triangles = (0..n)
        .flat_map(|i| {
            let [a, b, c, d] = [at(i, 0), at(i + 1, 0), at(i + 1, 1), at(i, 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    SurfaceMesh::new(vertices, triangles).unwrap()
}
