//! Surfaces, and meshes of cells.

use super::bridge::ffi;
use super::error::{Error, ErrorKind, guarded};
use super::{flat, path, points};
use solidmap::check::{self, CheckReport, ComponentKind, SelfIntersections, Severity};
use solidmap::io;
use solidmap::mesh::{CellList, CellMesh, SurfaceMesh, TetMesh, shapes};
use solidmap::remesh::{invalid_cells, quality};

pub struct Surface(pub SurfaceMesh);

pub struct VolumeMesh(pub CellMesh);

/// Largest number of divisions of built-in shapes; more can only be a mistake.
const MOST_DIVISIONS: usize = 1024;
/// Largest number of triangles of a polycube: they take some 2 GB while they are made.
const MOST_TRIANGLES: f64 = 3e7;

pub fn surface_new(vertices: &[f64], triangles: &[u32]) -> Result<Box<Surface>, Error> {
    guarded(|| {
        let triangles = whole::<_, 3>("triangle corners", triangles)?;
        boxed(SurfaceMesh::new(
            whole_points("vertices", vertices)?.to_vec(),
            triangles.to_vec(),
        )?)
    })
}

pub fn surface_load(bytes: &[u8]) -> Result<Box<Surface>, Error> {
    guarded(|| boxed(io::read_surface(path(bytes)?)?))
}

pub fn surface_sphere(radius: f64, levels: u32) -> Result<Box<Surface>, Error> {
    guarded(|| {
        require_length("radius", radius)?;
        if levels > 9 {
            return Err(Error::invalid(format!(
                "levels is {levels}, but must be at most 9 (2.6 million vertices)"
            )));
        }
        boxed(shapes::sphere(radius, levels))
    })
}

pub fn surface_cube(size: f64, divisions: usize) -> Result<Box<Surface>, Error> {
    guarded(|| {
        require_length("size", size)?;
        require_divisions("divisions", divisions, 1)?;
        boxed(shapes::cube(size, divisions))
    })
}

pub fn surface_polycube(cubes: &[i32], divisions: usize) -> Result<Box<Surface>, Error> {
    guarded(|| {
        let cubes = whole::<_, 3>("positions of cubes", cubes)?;
        require_divisions("divisions", divisions, 1)?;
        let far = cubes
            .as_flattened()
            .iter()
            .any(|c| c.unsigned_abs() as usize > MOST_DIVISIONS);
        if cubes.is_empty() || far {
            return Err(Error::invalid(format!(
                "a polycube needs cubes, at positions of at most {MOST_DIVISIONS}"
            )));
        }
        // At most all six sides of every cube.
        let most = 12.0 * cubes.len() as f64 * (divisions as f64).powi(2);
        if most > MOST_TRIANGLES {
            return Err(Error::new(
                ErrorKind::Memory,
                format!(
                    "{} cubes of {divisions} divisions have up to {most:.1e} triangles, more than {MOST_TRIANGLES:.1e}",
                    cubes.len()
                ),
            ));
        }
        boxed(shapes::polycube(cubes, divisions))
    })
}

pub fn surface_torus(major: f64, minor: f64, around: usize, across: usize) -> Result<Box<Surface>, Error> {
    guarded(|| {
        require_length("major", major)?;
        require_length("minor", minor)?;
        if minor >= major {
            return Err(Error::invalid(format!(
                "minor is {minor}, but must be less than major, {major}: the tube would pass through itself"
            )));
        }
        require_divisions("around", around, 3)?;
        require_divisions("across", across, 3)?;
        boxed(shapes::torus(major, minor, around, across))
    })
}

impl Surface {
    pub fn save(&self, bytes: &[u8]) -> Result<(), Error> {
        guarded(|| Ok(io::write_surface(path(bytes)?, &self.0)?))
    }

    pub fn vertices(&self) -> &[f64] {
        flat(self.0.vertices())
    }

    pub fn triangles(&self) -> &[u32] {
        self.0.triangles().as_flattened()
    }

    pub fn area(&self) -> f64 {
        self.0.area()
    }

    pub fn volume(&self) -> f64 {
        self.0.volume()
    }

    pub fn bounding_box(&self) -> [f64; 6] {
        let (low, high) = self.0.bounding_box().unwrap_or_default();
        [low.x, low.y, low.z, high.x, high.y, high.z]
    }

    pub fn check(&self, self_intersections: bool) -> Result<ffi::CheckReport, Error> {
        guarded(|| {
            if !self_intersections {
                return Ok(converted(&check::check(&self.0, None)));
            }
            #[cfg(feature = "native")]
            {
                let find = |surface: &SurfaceMesh| {
                    solidmap::cgal_tetgen::self_intersections(surface).map_err(|error| error.to_string())
                };
                Ok(converted(&check::check(&self.0, Some(&find))))
            }
            #[cfg(not(feature = "native"))]
            Err(super::solids::needs_native("looking for self-intersections"))
        })
    }

    pub fn repaired(&self, done: &mut Vec<String>) -> Result<Box<Surface>, Error> {
        guarded(|| {
            let (repaired, repairs) = check::repair(&self.0);
            done.extend(repairs.iter().map(ToString::to_string));
            boxed(repaired)
        })
    }

    pub fn with_holes_closed(&self, most_edges: usize, closed: &mut usize) -> Result<Box<Surface>, Error> {
        guarded(|| {
            let (surface, holes) = check::close_holes(&self.0, most_edges)?;
            *closed = holes.len();
            boxed(surface)
        })
    }
}

pub fn cells_tets(nodes: &[f64], corners: &[u32], regions: &[i32]) -> Result<Box<VolumeMesh>, Error> {
    guarded(|| {
        let tets = CellList::Tets(whole::<_, 4>("corners of tetrahedra", corners)?.to_vec());
        Ok(Box::new(VolumeMesh(CellMesh::new(
            whole_points("nodes", nodes)?.to_vec(),
            tets,
            regions.to_vec(),
        )?)))
    })
}

pub fn cells_hexes(nodes: &[f64], corners: &[u32], regions: &[i32]) -> Result<Box<VolumeMesh>, Error> {
    guarded(|| {
        let hexes = CellList::Hexes(whole::<_, 8>("corners of hexahedra", corners)?.to_vec());
        Ok(Box::new(VolumeMesh(CellMesh::new(
            whole_points("nodes", nodes)?.to_vec(),
            hexes,
            regions.to_vec(),
        )?)))
    })
}

pub fn cells_load(bytes: &[u8]) -> Result<Box<VolumeMesh>, Error> {
    guarded(|| Ok(Box::new(VolumeMesh(io::read_cells(path(bytes)?)?))))
}

impl VolumeMesh {
    pub fn save(&self, bytes: &[u8]) -> Result<(), Error> {
        guarded(|| Ok(io::write_cell_mesh(path(bytes)?, &self.0)?))
    }

    pub fn nodes(&self) -> &[f64] {
        flat(self.0.nodes())
    }

    pub fn corners(&self) -> &[u32] {
        match self.0.cells() {
            CellList::Tets(tets) => tets.as_flattened(),
            CellList::Hexes(hexes) => hexes.as_flattened(),
        }
    }

    pub fn regions(&self) -> &[i32] {
        self.0.regions()
    }

    pub fn are_hexes(&self) -> bool {
        matches!(self.0.cells(), CellList::Hexes(_))
    }

    pub fn with_nodes(&self, nodes: &[f64]) -> Result<Box<VolumeMesh>, Error> {
        guarded(|| {
            let nodes = whole_points("nodes", nodes)?;
            if nodes.len() != self.0.nodes().len() {
                return Err(Error::invalid(format!(
                    "{} nodes were given for a mesh of {}; give the position of every node, in order",
                    nodes.len(),
                    self.0.nodes().len()
                )));
            }
            let (cells, regions) = (self.0.cells().clone(), self.0.regions().to_vec());
            Ok(Box::new(VolumeMesh(CellMesh::new(nodes.to_vec(), cells, regions)?)))
        })
    }

    pub fn boundary(&self, nodes: &mut Vec<u32>) -> Result<Box<Surface>, Error> {
        guarded(|| {
            let boundary = self.0.boundary();
            *nodes = boundary.vertex_ids;
            boxed(boundary.surface)
        })
    }

    pub fn inverted(&self) -> Result<Vec<u32>, Error> {
        guarded(|| Ok(invalid_cells(self.0.cells(), self.0.nodes()).cells))
    }

    pub fn quality(&self) -> Result<ffi::CellQuality, Error> {
        guarded(|| Ok(quality_of(self.0.cells(), self.0.nodes())))
    }

    pub fn check(&self) -> Result<ffi::CellReport, Error> {
        guarded(|| {
            let report = check::examine_cells(&self.0);
            let finding = |f: &check::CellFinding| ffi::CellFinding {
                kind: name_of(&f.kind),
                severity: severity_of(f.severity),
                count: f.count,
                cells: f.cells.clone(),
                vertices: f.vertices.clone(),
                places: f.places.as_flattened().to_vec(),
                message: f.message.clone(),
                advice: f.advice.clone(),
            };
            Ok(ffi::CellReport {
                valid: report.is_valid(),
                inverted: report.inverted_cells,
                flat: report.flat_cells,
                slivers: report.slivers,
                body_cells: report.bodies.iter().map(|body| body.cells).collect(),
                body_volumes: report.bodies.iter().map(|body| body.volume).collect(),
                findings: report.findings.iter().map(finding).collect(),
                text: report.to_string(),
            })
        })
    }
}

/// How many cells are inverted, and the shape quality of all.
pub fn quality_of(cells: &CellList, nodes: &[solidmap::Point]) -> ffi::CellQuality {
    let found = quality(cells, nodes);
    let value = |of: fn(&solidmap::remesh::CellQuality) -> f64| found.as_ref().map_or(f64::NAN, of);
    ffi::CellQuality {
        cells: cells.len(),
        inverted: invalid_cells(cells, nodes).cells.len(),
        min_scaled_jacobian: value(|q| q.min_scaled_jacobian),
        p01_scaled_jacobian: value(|q| q.p01_scaled_jacobian),
        mean_scaled_jacobian: value(|q| q.mean_scaled_jacobian),
        min_dihedral: value(|q| q.min_dihedral),
        max_dihedral: value(|q| q.max_dihedral),
    }
}

/// The tetrahedra of a mesh; an error for one of hexahedra, which begins with `why`.
pub fn tets_of(mesh: &VolumeMesh, why: &str) -> Result<TetMesh, Error> {
    match mesh.0.clone().into_parts() {
        (nodes, CellList::Tets(tets), _) => Ok(TetMesh::new(nodes, tets)?),
        _ => Err(Error::invalid(format!("{why} tetrahedra; give a mesh of them"))),
    }
}

/// The elements in rows of `N`; an error when some are left over.
pub fn whole<'a, T, const N: usize>(what: &str, elements: &'a [T]) -> Result<&'a [[T; N]], Error> {
    match elements.as_chunks::<N>() {
        (whole, []) => Ok(whole),
        _ => Err(Error::invalid(format!(
            "{} {what} were given, which is not a multiple of {N}",
            elements.len()
        ))),
    }
}

/// Coordinates as points, none left over.
pub fn whole_points<'a>(what: &str, coordinates: &'a [f64]) -> Result<&'a [solidmap::Point], Error> {
    whole::<f64, 3>(&format!("coordinates of {what}"), coordinates)?;
    Ok(points(coordinates))
}

pub fn boxed(surface: SurfaceMesh) -> Result<Box<Surface>, Error> {
    Ok(Box::new(Surface(surface)))
}

fn require_length(name: &str, value: f64) -> Result<(), Error> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "{name} is {value}, but must be positive and finite"
    )))
}

fn require_divisions(name: &str, value: usize, least: usize) -> Result<(), Error> {
    if (least..=MOST_DIVISIONS).contains(&value) {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "{name} is {value}, but must be from {least} to {MOST_DIVISIONS}"
    )))
}

fn converted(report: &CheckReport) -> ffi::CheckReport {
    let component = |c: &check::ComponentReport| ffi::Component {
        triangles: c.faces,
        vertices: c.vertices,
        genus: c.genus.map_or(-1, |genus| genus as i64),
        area: c.area,
        volume: c.volume.unwrap_or(f64::NAN),
        shell: c.kind != ComponentKind::NotAShell,
        cavity: c.kind == ComponentKind::Cavity,
    };
    let finding = |f: &check::Finding| ffi::Finding {
        kind: name_of(&f.kind),
        severity: severity_of(f.severity),
        count: f.count,
        vertices: f.vertices.clone(),
        edges: f.edges.as_flattened().to_vec(),
        triangles: f.faces.clone(),
        message: f.message.clone(),
        advice: f.advice.clone(),
    };
    ffi::CheckReport {
        solvable: report.is_solvable(),
        closed: report.closed,
        edge_manifold: report.edge_manifold,
        vertex_manifold: report.vertex_manifold,
        oriented: report.consistently_oriented,
        outward: report.outward,
        self_intersections: match report.self_intersections {
            SelfIntersections::Checked { pairs } => pairs as i64,
            SelfIntersections::NotChecked { .. } => -1,
        },
        area: report.area,
        volume: report.volume.unwrap_or(f64::NAN),
        components: report.components.iter().map(component).collect(),
        findings: report.findings.iter().map(finding).collect(),
        text: report.to_string(),
    }
}

/// The number of a severity in C++.
fn severity_of(severity: Severity) -> u8 {
    match severity {
        Severity::Error => 0,
        Severity::Warning => 1,
        Severity::Note => 2,
    }
}

/// The name of a value in JSON reports.
pub fn name_of(value: &impl serde::Serialize) -> String {
    let name = serde_json::to_value(value).ok();
    name.and_then(|name| name.as_str().map(str::to_owned))
        .unwrap_or_default()
}
