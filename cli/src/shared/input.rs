//! Reading files, and checks of those to be written.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::{Deserialize, Serialize};
use solidmap::boundary_map::{BoundaryMap, BoundaryMapError};
use solidmap::check;
use solidmap::files::{self, MapFile, Provenance};
use solidmap::fit::FitError;
use solidmap::io::{self, SolidMesh};
use solidmap::mesh::SurfaceMesh;

use super::stored_paths;
use crate::args::BoundaryMapFiles;

/// A closed surface, or a mesh of tetrahedra or hexahedra. That a path is a folder says more than that it has no known
/// extension.
pub fn read_solid(path: &Path) -> anyhow::Result<SolidMesh> {
    anyhow::ensure!(!path.is_dir(), "cannot read `{}`: it is a folder", path.display());
    Ok(io::read_solid(path)?)
}

/// A closed surface, or the boundary of a mesh of tetrahedra or hexahedra.
pub fn read_surface(path: &Path) -> anyhow::Result<SurfaceMesh> {
    Ok(read_solid(path)?.into_surface())
}

/// Refuses a surface that bounds no solid, of which no method can make a map.
pub fn require_solvable(domain: &SurfaceMesh, path: &Path) -> anyhow::Result<()> {
    let report = check::check(domain, None);
    anyhow::ensure!(
        report.is_solvable(),
        "cannot map `{}`: {}",
        path.display(),
        FitError::DefectiveDomain(Box::new(report))
    );
    Ok(())
}

/// Where a boundary map comes from.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum BoundarySource {
    /// Two meshes of one connectivity.
    Image {
        #[serde(with = "stored_paths")]
        domain: PathBuf,
        #[serde(with = "stored_paths")]
        image: PathBuf,
    },
    /// A boundary file, and its domain if that is named.
    File {
        #[serde(with = "stored_paths")]
        file: PathBuf,
        #[serde(with = "stored_paths")]
        domain: Option<PathBuf>,
    },
}

impl BoundaryMapFiles {
    /// Where the boundary map comes from, unless it is to be made.
    pub fn source(&self) -> Option<BoundarySource> {
        match (self.domain.clone(), self.image.clone(), self.boundary.clone()) {
            (domain, None, Some(file)) => Some(BoundarySource::File { file, domain }),
            (Some(domain), Some(image), None) => Some(BoundarySource::Image { domain, image }),
            _ => None,
        }
    }
}

impl BoundarySource {
    pub fn read(&self) -> anyhow::Result<BoundaryMap> {
        match self {
            Self::Image { domain, image } => read_boundary_map(domain, image),
            Self::File { file, domain } => read_boundary_file(file, domain.as_deref()),
        }
    }

    /// The files that are read, by their roles.
    pub fn files_by_role(&self) -> Vec<(&'static str, &Path)> {
        match self {
            Self::Image { domain, image } => vec![("domain", domain), ("image", image)],
            Self::File { file, domain } => {
                let domain = domain.as_deref().map(|domain| ("domain", domain));
                domain.into_iter().chain([("boundary", file.as_path())]).collect()
            }
        }
    }

    /// The files that are read.
    pub fn files(&self) -> Vec<&Path> {
        self.files_by_role().into_iter().map(|(_, path)| path).collect()
    }

    /// The domain, or the file that it comes in.
    pub fn domain(&self) -> &Path {
        self.files()[0]
    }

    /// The image, or the boundary file.
    pub fn image(&self) -> &Path {
        match self {
            Self::Image { image, .. } => image,
            Self::File { file, .. } => file,
        }
    }
}

/// The boundary map from one file to another of the same connectivity.
pub fn read_boundary_map(domain: &Path, image: &Path) -> anyhow::Result<BoundaryMap> {
    if is_node_images(image) {
        let map = read_map_of_nodes(domain, image)?;
        return map.with_context(|| format!("cannot map `{}` by `{}`", domain.display(), image.display()));
    }
    let (domain_solid, image_solid) = rayon::join(|| read_solid(domain), || read_solid(image));
    let map = match (domain_solid?, image_solid?) {
        (SolidMesh::Cells(domain), SolidMesh::Cells(image)) => BoundaryMap::between_cells(&domain, &image),
        (SolidMesh::Surface(domain), SolidMesh::Surface(surface)) => {
            let surface = cut_as(image, surface, &domain)?;
            BoundaryMap::between(domain, &surface)
        }
        (domain, image) => BoundaryMap::between(domain.into_surface(), &image.into_surface()),
    };
    map.with_context(|| format!("cannot map `{}` to `{}`", domain.display(), image.display()))
}

/// Whether a file holds the images of nodes, as lines `node x y z`.
pub fn is_node_images(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("txt"))
}

/// The boundary map of a mesh, or of a surface, whose nodes go where a file says.
fn read_map_of_nodes(domain: &Path, images: &Path) -> anyhow::Result<Result<BoundaryMap, BoundaryMapError>> {
    let (solid, images) = (read_solid(domain)?, io::read_node_images(images)?);
    Ok(match solid {
        SolidMesh::Cells(mesh) => BoundaryMap::of_nodes(&mesh, &images),
        SolidMesh::Surface(surface) => BoundaryMap::of_vertices(surface, &images),
    })
}

/// The image of a surface, from a file with the same faces.
pub fn read_image(path: &Path, domain: &SurfaceMesh) -> anyhow::Result<SurfaceMesh> {
    cut_as(path, read_surface(path)?, domain)
}

/// A surface as it was read, or read again with its polygons cut as those of another one.
fn cut_as(path: &Path, read: SurfaceMesh, other: &SurfaceMesh) -> anyhow::Result<SurfaceMesh> {
    let may_be_cut = read.triangles().len() == other.triangles().len() && read.triangles() != other.triangles();
    Ok(match may_be_cut {
        true => io::read_surface_as(path, other)?,
        false => read,
    })
}

/// The boundary map of a boundary file; of this domain, if one is named.
pub fn read_boundary_file(path: &Path, domain: Option<&Path>) -> anyhow::Result<BoundaryMap> {
    let boundary = files::read_boundary(path)?.boundary;
    let Some(domain) = domain else {
        return Ok(boundary);
    };
    let (repaired, _) = check::repair(&read_surface(domain)?);
    boundary.over(repaired).with_context(|| {
        format!(
            "`{}` is not the domain of `{}`; name the model that the boundary map was made for, or leave it out",
            domain.display(),
            path.display()
        )
    })
}

/// A map file and the boundary map it was fitted to.
pub fn read_fitted_map(path: &Path) -> anyhow::Result<(MapFile, BoundaryMap)> {
    let file = files::read_map(path)?;
    let boundary = file
        .boundary
        .clone()
        .with_context(|| format!("`{}` holds a map without its domain; fit it again", path.display()))?;
    Ok((file, boundary))
}

/// Refuses an output before any work is done: a folder, a file in a folder that does not exist, one of the `others`
/// that are read or written too, or another extension than `extensions` (empty: any).
pub fn require_writable(path: &Path, extensions: &[&str], others: &[&Path]) -> anyhow::Result<()> {
    let shown = path.display();
    anyhow::ensure!(!path.is_dir(), "cannot write `{shown}`: it is a folder");
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        anyhow::bail!("cannot write `{shown}`: there is no folder `{}`", folder.display());
    }
    let canonical = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    anyhow::ensure!(
        !others.iter().any(|other| canonical(other) == canonical(path)),
        "`{shown}` would be overwritten: it is named twice, as an output and as another file"
    );
    anyhow::ensure!(
        extensions.is_empty() || extensions.contains(&extension(path).as_str()),
        "cannot write `{shown}`: name it .{}",
        extensions.join(" or .")
    );
    Ok(())
}

/// [`require_writable`] for each output that is given; none may be another one, or one of `inputs`.
pub fn require_all_writable(outputs: &[(Option<&PathBuf>, &[&str])], inputs: &[&Path]) -> anyhow::Result<()> {
    let mut others = inputs.to_vec();
    for (path, extensions) in outputs {
        if let Some(path) = path {
            require_writable(path, extensions, &others)?;
            others.push(path);
        }
    }
    Ok(())
}

/// The extension in lower case; empty when there is none.
pub fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// A file as results list it among their inputs.
pub fn provenance(role: &str, path: &Path) -> anyhow::Result<Provenance> {
    Provenance::of(role, path).with_context(|| format!("cannot read `{}`", path.display()))
}

/// The default limit on the memory, in bytes: a tenth of the available memory stays free.
pub fn most_memory() -> Option<u64> {
    solidmap::memory::default_budget()
}
