//! Preparation of given meshes: the boundary is found, and cells are oriented.

use super::bounded_mesh::{BoundedMesh, CellFace, faces};
use super::grid::MAX_CELLS;
use crate::Point;
use crate::geometry::{QueryError, SurfaceQuery};
use crate::mesh::{CellList, CellMesh, SurfaceMesh};

/// Why a given mesh cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GivenMeshError {
    /// The mesh has no cells.
    #[error("it has no cells")]
    Empty,
    /// A node has a NaN or infinite coordinate.
    #[error("node {node} (0-based) is at {at}; every node needs finite coordinates")]
    NotFinite {
        /// Which, 0-based.
        node: usize,
        /// Its coordinates.
        at: Point,
    },
    /// A cell has the same node at two corners.
    #[error("cell {cell} (0-based) names node {node} twice; remove collapsed cells")]
    Collapsed {
        /// Which, 0-based.
        cell: usize,
        /// The node, 0-based.
        node: u32,
    },
    /// Three cells or more meet at a face.
    #[error("{count} cells meet at the face with nodes {nodes:?} (0-based); at most two may")]
    NotConforming {
        /// Cells there.
        count: usize,
        /// Its nodes, 0-based.
        nodes: Vec<u32>,
    },
    /// Two hexahedra share the four nodes of a face, but connect them to different quads.
    #[error("cells {cells:?} (0-based) connect the four nodes of their common face in different ways; repair the mesh")]
    OtherQuad {
        /// Which, 0-based.
        cells: [u32; 2],
    },
    /// The cells cannot be oriented consistently.
    #[error(
        "cells {cells:?} (0-based) lie on the same side of their face, however cells are oriented; repair the mesh"
    )]
    NotOrientable {
        /// Which, 0-based.
        cells: [u32; 2],
    },
    /// There are more cells than the limit.
    #[error("it has {cells} cells, more than the limit of {limit:.0}", limit = MAX_CELLS)]
    TooMany {
        /// How many.
        cells: usize,
    },
    /// The boundary of the mesh is not the surface of the map's domain.
    #[error(
        "node {node} (0-based) of its boundary is {distance:.2e} of the diagonal away from the surface of the map's domain; \
         give a mesh of the domain, in the same place and units"
    )]
    OtherPlace {
        /// Which, 0-based.
        node: usize,
        /// How far, as a fraction of the domain's diagonal.
        distance: f64,
    },
    /// The mesh does not have the volume of the domain.
    #[error("it has a volume of {mesh}, the map's domain {domain}; give a mesh that fills the domain")]
    OtherVolume {
        /// The mesh's volume.
        mesh: f64,
        /// The domain's volume.
        domain: f64,
    },
    /// The domain cannot be queried.
    #[error(transparent)]
    Query(#[from] QueryError),
}

/// A given mesh, ready to be mapped.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenMesh {
    /// The mesh, with its nodes and cells as they were given.
    pub mesh: BoundedMesh,
    /// Largest distance of a boundary node from the domain's surface, as a fraction of its diagonal. Such nodes are
    /// mapped like the nearest point of the surface.
    pub off_surface: f64,
}

/// Largest allowed distance of a boundary node from the domain's surface, as a fraction of the diagonal.
const OFF_SURFACE: f64 = 0.01;
/// Largest allowed relative difference of volumes.
const OTHER_VOLUME: f64 = 0.1;

/// Finds the boundary of a mesh of `domain`, and orients its cells.
///
/// # Errors
///
/// When the cells do not form a conforming mesh of this domain.
pub fn given_mesh(mesh: CellMesh, domain: &SurfaceMesh) -> Result<GivenMesh, GivenMeshError> {
    check_cells(&mesh)?;
    let mut cell_faces = faces(mesh.cells());
    check_faces(&cell_faces)?;
    let (mesh, any_reversed) = oriented(mesh, &cell_faces)?;
    if any_reversed {
        cell_faces = faces(mesh.cells());
    }
    let mesh = BoundedMesh::of(mesh, &cell_faces);
    let off_surface = check_place(&mesh, domain)?;
    Ok(GivenMesh { mesh, off_surface })
}

fn check_cells(mesh: &CellMesh) -> Result<(), GivenMeshError> {
    if mesh.cells().is_empty() {
        return Err(GivenMeshError::Empty);
    }
    if mesh.cells().len() as f64 > MAX_CELLS {
        return Err(GivenMeshError::TooMany {
            cells: mesh.cells().len(),
        });
    }
    let is_finite = |p: &Point| p.iter().all(|x| x.is_finite());
    if let Some(node) = mesh.nodes().iter().position(|p| !is_finite(p)) {
        let at = mesh.nodes()[node];
        return Err(GivenMeshError::NotFinite { node, at });
    }
    let twice = |c: &[u32]| (1..c.len()).find(|&k| c[..k].contains(&c[k])).map(|k| c[k]);
    let mut cells = mesh.cells().iter().enumerate();
    match cells.find_map(|(cell, corners)| Some((cell, twice(corners)?))) {
        Some((cell, node)) => Err(GivenMeshError::Collapsed { cell, node }),
        None => Ok(()),
    }
}

/// Requires that at most two cells meet at a face, and that they connect its nodes in the same way.
fn check_faces(faces: &[CellFace]) -> Result<(), GivenMeshError> {
    for group in faces.chunk_by(|a, b| a.nodes == b.nodes) {
        match group {
            [_] => {}
            [a, b] if a.opposite == b.opposite => {}
            [a, b] => {
                return Err(GivenMeshError::OtherQuad {
                    cells: [a.cell, b.cell],
                });
            }
            _ => {
                return Err(GivenMeshError::NotConforming {
                    count: group.len(),
                    nodes: group[0].nodes.iter().copied().filter(|v| *v != u32::MAX).collect(),
                });
            }
        }
    }
    Ok(())
}

/// The mesh with its cells oriented, and whether any was reversed. Neighbours are made consistent, and each connected
/// part gets a positive volume, so that inverted cells stay inverted.
fn oriented(mesh: CellMesh, faces: &[CellFace]) -> Result<(CellMesh, bool), GivenMeshError> {
    let (nodes, mut cells, regions) = mesh.into_parts();
    let det = |[a, b, c, d]: [u32; 4]| {
        let [a, b, c, d] = [a, b, c, d].map(|v| nodes[v as usize]);
        (b - a).dot(&(c - a).cross(&(d - a)))
    };
    // The tetrahedra at two opposite corners stand in for a hexahedron's volume.
    let volume = |c: u32| match &cells {
        CellList::Tets(tets) => det(tets[c as usize]),
        CellList::Hexes(hexes) => {
            let at = |corner: [usize; 4]| det(corner.map(|k| hexes[c as usize][k]));
            at([0, 1, 3, 4]) + at([6, 5, 7, 2])
        }
    };
    let neighbours = neighbours(faces, cells.len());
    let mut is_reversed: Vec<Option<bool>> = vec![None; cells.len()];
    for first in 0..cells.len() as u32 {
        if is_reversed[first as usize].is_some() {
            continue;
        }
        is_reversed[first as usize] = Some(false);
        let (mut part, mut next) = (vec![first], 0);
        while let Some(&at) = part.get(next) {
            next += 1;
            let reversed = is_reversed[at as usize] == Some(true);
            for &(other, consistent) in neighbours.of(at) {
                let expected = reversed == consistent;
                match is_reversed[other as usize] {
                    None => {
                        is_reversed[other as usize] = Some(expected);
                        part.push(other);
                    }
                    Some(is) if is != expected => return Err(GivenMeshError::NotOrientable { cells: [at, other] }),
                    Some(_) => {}
                }
            }
        }
        let signed = |&c: &u32| match is_reversed[c as usize] {
            Some(true) => -volume(c),
            _ => volume(c),
        };
        if part.iter().map(signed).sum::<f64>() < 0.0 {
            for &c in &part {
                is_reversed[c as usize] = is_reversed[c as usize].map(|is| !is);
            }
        }
    }
    let reversed: Vec<usize> = (0..cells.len()).filter(|c| is_reversed[*c] == Some(true)).collect();
    match &mut cells {
        CellList::Tets(tets) => reversed.iter().for_each(|&c| tets[c].swap(2, 3)),
        CellList::Hexes(hexes) => reversed.iter().for_each(|&c| hexes[c].rotate_left(4)),
    }
    let mesh = CellMesh::new(nodes, cells, regions).expect("the same counts");
    Ok((mesh, !reversed.is_empty()))
}

/// The cells across the faces of each cell.
struct CellNeighbours {
    starts: Vec<usize>,
    /// A neighbour, and whether it is oriented consistently with the cell.
    cells: Vec<(u32, bool)>,
}

impl CellNeighbours {
    fn of(&self, cell: u32) -> &[(u32, bool)] {
        &self.cells[self.starts[cell as usize]..self.starts[cell as usize + 1]]
    }
}

fn neighbours(faces: &[CellFace], cells: usize) -> CellNeighbours {
    let pairs = || {
        faces
            .chunk_by(|a, b| a.nodes == b.nodes)
            .filter_map(|group| match group {
                [a, b] => Some((a.cell, b.cell, a.reversed != b.reversed)),
                _ => None,
            })
    };
    let mut starts = vec![0; cells + 1];
    for (a, b, _) in pairs() {
        starts[a as usize + 1] += 1;
        starts[b as usize + 1] += 1;
    }
    for c in 0..cells {
        starts[c + 1] += starts[c];
    }
    let mut next = starts.clone();
    let mut found = vec![(0, false); starts[cells]];
    for (a, b, consistent) in pairs() {
        for (from, to) in [(a, b), (b, a)] {
            found[next[from as usize]] = (to, consistent);
            next[from as usize] += 1;
        }
    }
    CellNeighbours { starts, cells: found }
}

/// Requires that the mesh fills the domain; returns how far its boundary nodes are from the surface.
fn check_place(mesh: &BoundedMesh, domain: &SurfaceMesh) -> Result<f64, GivenMeshError> {
    let query = SurfaceQuery::with_winding_sign(domain)?;
    let diagonal = domain.diagonal();
    let nodes: Vec<usize> = (0..mesh.nodes.len()).filter(|&v| mesh.on_boundary[v]).collect();
    let places: Vec<Point> = nodes.iter().map(|&v| mesh.nodes[v]).collect();
    let found = query.closest_points(&places);
    let farthest = found
        .iter()
        .enumerate()
        .max_by(|(_, a), (_, b)| a.distance.total_cmp(&b.distance));
    let (node, distance) = farthest.map_or((0, 0.0), |(k, place)| (nodes[k], place.distance / diagonal));
    if distance > OFF_SURFACE {
        return Err(GivenMeshError::OtherPlace { node, distance });
    }
    let boundary = SurfaceMesh::new(mesh.nodes.clone(), mesh.boundary.clone()).expect("boundary triangles name nodes");
    let [of_mesh, of_domain] = [boundary.volume(), domain.volume().abs()];
    if (of_mesh - of_domain).abs() > OTHER_VOLUME * of_domain {
        return Err(GivenMeshError::OtherVolume {
            mesh: of_mesh,
            domain: of_domain,
        });
    }
    Ok(distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_cells_and_whole_parts_are_oriented() {
        let nodes: Vec<Point> = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]]
            .map(Point::from)
            .into();
        let right = [[0, 1, 2, 3], [1, 2, 3, 4]];
        let det = |t: &[u32; 4]| {
            let p = t.map(|v| nodes[v as usize]);
            (p[1] - p[0]).dot(&(p[2] - p[0]).cross(&(p[3] - p[0])))
        };
        for swaps in [[false, false], [true, true], [true, false], [false, true]] {
            let mut tets = right;
            tets.iter_mut().zip(swaps).for_each(|(t, swap)| {
                if swap {
                    t.swap(0, 1);
                }
            });
            let mesh = CellMesh::new(nodes.clone(), CellList::Tets(tets.to_vec()), vec![0, 0]).unwrap();
            let cell_faces = faces(mesh.cells());
            let CellList::Tets(oriented) = oriented(mesh, &cell_faces).unwrap().0.cells().clone() else {
                panic!("tets")
            };
            assert!(oriented.iter().all(|t| det(t) > 0.0), "{swaps:?}");
        }
    }
}
