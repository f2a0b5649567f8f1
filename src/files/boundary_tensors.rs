//! Boundary maps as tensors, in boundary files and map files alike.
//!
//! | tensor | type, shape | meaning |
//! |---|---|---|
//! | `domain_vertices`, `image_vertices` | f64, n × 3 | vertices of the domain and their images |
//! | `domain_triangles` | u32, m × 3 | triangles of the domain |
//! | `domain_directions` | f64, n × 3 | `onto_sphere`, `through_sphere`: each vertex on the unit sphere |
//! | `target_vertices`, `target_triangles`, `target_directions` | as above | `through_sphere`: the same of the target |
//! | `domain_positions` | f64, n × 2 | `through_torus`: each vertex in the unit square, whose opposite sides are glued |
//! | `domain_translations` | i32, m × 6 | `through_torus`: whole numbers by which the corners of each triangle are translated |
//! | `target_vertices`, `target_triangles`, `target_positions`, `target_translations` | as above | the same of the target |
//! | `domain_places` | f64, n × 2 | `through_hyperbolic_surface`: the first two coordinates of each vertex on the hyperboloid `x² + y² − z² = −1` |
//! | `domain_word_lengths` | i32, m × 3 | the numbers of letters of the words that take the corners of each triangle to one copy of it |
//! | `domain_letters` | i32, l × 1 | their letters, one word after the other, the last letter of each applied first |
//! | `relator` | i32, 4g × 1 | the letters of the polygons around a corner of the regular polygon with 4g sides, counter-clockwise |
//! | `target_vertices`, `target_triangles`, `target_places`, `target_word_lengths`, `target_letters` | as above | the same of the target |
//! | `target_vertices`, `target_triangles` | as above | `by_shells`: the target |
//!
//! With `by_shells`, the object `shells` of `boundary` has for each shell of the domain the shell of the target that it goes to,
//! `target`, and `way`. Shells are the connected components in the order of their first triangles. The tensors of shell 0 that its way
//! asks for, but for vertices and triangles, have names that begin with `shell0_`, and so on. Their rows are those of the shell's
//! vertices and triangles in the order of the whole surface; triangles of cavities are reversed, `[a, c, b]`.
//!
//! The object `boundary` of the metadata says which of them the file has. Images of compositions follow from the
//! directions or positions; they are stored for readers that need only the vertices, and compared when the map is read. A subdivided
//! domain is stored as it was before, with the number of subdivisions.

use super::TensorFileError;
use super::tensor_file::{Reader, Tensor};
use crate::boundary_map::{BoundaryMap, ShellMap};
use crate::check::shells_of;
use crate::hyperbolic::{HyperbolicEmbedding, HyperbolicError, Letter};
use crate::mesh::SurfaceMesh;
use crate::spherical::SphericalEmbedding;
use crate::toroidal::{ToroidalEmbedding, ToroidalError};
use crate::{Point, Vector};

/// What the metadata say about a boundary map.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct BoundaryHeader {
    pub way: Way,
    #[serde(default)]
    pub subdivisions: u32,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shells: Vec<ShellHeader>,
}

/// What the metadata say about the map of a shell.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct ShellHeader {
    pub target: usize,
    pub way: Way,
}

/// How the map is defined between vertices: linearly, by the domain's spherical embedding, by embeddings of both surfaces
/// in the sphere, in a flat torus or in a hyperbolic surface, or for each shell by itself.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Way {
    #[default]
    Straight,
    OntoSphere,
    ThroughSphere,
    ThroughTorus,
    ThroughHyperbolicSurface,
    ByShells,
}

/// The part of the metadata about the boundary map. Files without it hold a straight map.
#[derive(Default, serde::Deserialize)]
struct Headers {
    #[serde(default)]
    boundary: BoundaryHeader,
}

/// Most triangles that a domain may have after more than three subdivisions.
const MOST_SUBDIVIDED: u64 = 1 << 20;

/// By how much stored images may differ from the map's, as a fraction of the target's diagonal.
const AGREEMENT: f64 = 1e-9;

/// The names of the tensors of an embedded surface.
struct Names {
    vertices: String,
    triangles: String,
    directions: String,
    positions: String,
    translations: String,
    places: String,
    word_lengths: String,
    letters: String,
    relator: String,
}

impl Names {
    /// The names for the `side` `domain` or `target`: of one shell's map, or without `shell` of the whole map.
    fn of(side: &str, shell: Option<usize>) -> Self {
        let prefix = shell.map_or_else(String::new, |shell| format!("shell{shell}_"));
        let named = |what: &str| format!("{prefix}{side}_{what}");
        Self {
            vertices: named("vertices"),
            triangles: named("triangles"),
            directions: named("directions"),
            positions: named("positions"),
            translations: named("translations"),
            places: named("places"),
            word_lengths: named("word_lengths"),
            letters: named("letters"),
            relator: format!("{prefix}relator"),
        }
    }

    fn pair(shell: Option<usize>) -> [Self; 2] {
        ["domain", "target"].map(|side| Self::of(side, shell))
    }
}

const IMAGE: &str = "image_vertices";

pub(super) fn header_of(map: &BoundaryMap) -> BoundaryHeader {
    let shells = map.shells().unwrap_or_default().iter();
    BoundaryHeader {
        way: way_of(map),
        subdivisions: map.subdivisions(),
        shells: shells
            .map(|shell| ShellHeader {
                target: shell.target,
                way: way_of(&shell.map),
            })
            .collect(),
    }
}

fn way_of(map: &BoundaryMap) -> Way {
    match (map.domain_embedding(), map.target_embedding()) {
        _ if map.shells().is_some() => Way::ByShells,
        _ if map.torus_embeddings().is_some() => Way::ThroughTorus,
        _ if map.hyperbolic_embeddings().is_some() => Way::ThroughHyperbolicSurface,
        (None, _) => Way::Straight,
        (Some(_), None) => Way::OntoSphere,
        (Some(_), Some(_)) => Way::ThroughSphere,
    }
}

pub(super) fn tensors_of(map: &BoundaryMap) -> Vec<Tensor> {
    let domain = map.unsubdivided_domain();
    let [of_domain, of_target] = Names::pair(None);
    // The first vertices of a subdivided domain are the old ones.
    let image = &map.image()[..domain.vertices().len()];
    let mut tensors = Vec::from(surface_tensors(&of_domain, domain));
    tensors.push(Tensor::points(IMAGE, image));
    if let Some(target) = map.target_surface() {
        tensors.extend(surface_tensors(&of_target, target));
    }
    tensors.extend(embedding_tensors(map, None));
    for (shell, found) in map.shells().unwrap_or_default().iter().enumerate() {
        tensors.extend(embedding_tensors(&found.map, Some(shell)));
    }
    tensors
}

/// What a map without shells, or that of a shell, goes through.
fn embedding_tensors(map: &BoundaryMap, shell: Option<usize>) -> Vec<Tensor> {
    let [of_domain, of_target] = Names::pair(shell);
    let mut tensors = Vec::new();
    tensors.extend(
        map.domain_embedding()
            .map(|embedding| directions(&of_domain, embedding)),
    );
    tensors.extend(
        map.target_embedding()
            .map(|embedding| directions(&of_target, embedding)),
    );
    if let Some([domain, target]) = map.torus_embeddings() {
        tensors.extend(layout(&of_domain, domain));
        tensors.extend(layout(&of_target, target));
    }
    if let Some([domain, target]) = map.hyperbolic_embeddings() {
        tensors.extend(places_and_words(&of_domain, domain));
        tensors.extend(places_and_words(&of_target, target));
        let letters: Vec<[i32; 1]> = domain.relator().iter().map(|&letter| [i32::from(letter)]).collect();
        tensors.push(Tensor::integers(&of_domain.relator, letters.into_iter()));
    }
    tensors
}

fn places_and_words(names: &Names, embedding: &HyperbolicEmbedding) -> [Tensor; 3] {
    let lengths: Vec<[i32; 3]> = embedding
        .corner_letters()
        .map(|words| words.map(|word| word.len() as i32))
        .collect();
    let letters: Vec<[i32; 1]> = embedding
        .corner_letters()
        .flatten()
        .flatten()
        .map(|&letter| [i32::from(letter)])
        .collect();
    [
        Tensor::rows(&names.places, embedding.positions().iter()),
        Tensor::integers(&names.word_lengths, lengths.into_iter()),
        Tensor::integers(&names.letters, letters.into_iter()),
    ]
}

fn layout(names: &Names, embedding: &ToroidalEmbedding) -> [Tensor; 2] {
    let translations = embedding.translations().iter();
    [
        Tensor::rows(&names.positions, embedding.positions().iter()),
        Tensor::integers(
            &names.translations,
            translations.map(|[a, b, c]| [a[0], a[1], b[0], b[1], c[0], c[1]]),
        ),
    ]
}

fn surface_tensors(names: &Names, surface: &SurfaceMesh) -> [Tensor; 2] {
    [
        Tensor::points(&names.vertices, surface.vertices()),
        Tensor::triangles(&names.triangles, surface.triangles()),
    ]
}

fn directions(names: &Names, embedding: &SphericalEmbedding) -> Tensor {
    Tensor::rows(&names.directions, embedding.directions().iter().map(|x| x.as_ref()))
}

/// The boundary map of a file. Whether its embeddings are one to one is decided again, exactly.
pub(super) fn read(reader: &Reader) -> Result<BoundaryMap, TensorFileError> {
    let header = reader.metadata::<Headers>()?.boundary;
    let image = reader.points(IMAGE)?;
    let unusable = |e: &dyn std::fmt::Display| reader.problem(IMAGE, format!("is unusable: {e}"));
    let of_domain = Names::of("domain", None);
    require_no_others(reader, header.way, None)?;
    require_no_other_shells(reader, header.shells.len())?;
    let domain = surface(reader, &of_domain)?;
    let map = match header.way {
        Way::Straight => return BoundaryMap::new(domain, image).map_err(|e| unusable(&e)),
        Way::ByShells => by_shells(reader, &domain, &header.shells)?,
        way => {
            let target = match way {
                Way::OntoSphere => None,
                _ => Some(surface(reader, &Names::of("target", None))?),
            };
            through_embeddings(reader, way, domain, target, None)?
        }
    };
    require_agreement(reader, &map, &image)?;
    let (count, subdivisions) = (map.domain().triangles().len() as u64, header.subdivisions);
    // A few bytes must not ask for gigabytes.
    let is_too_fine = subdivisions > 15 || (subdivisions > 3 && count << (2 * subdivisions) > MOST_SUBDIVIDED);
    if is_too_fine {
        let problem = format!("has {count} rows, too many to be cut into four {subdivisions} times");
        return Err(reader.problem(&of_domain.triangles, problem));
    }
    Ok((0..subdivisions).fold(map, |map, _| map.subdivided()))
}

/// # Errors
///
/// When the file has tensors of embeddings that do not belong to this way.
fn require_no_others(reader: &Reader, way: Way, shell: Option<usize>) -> Result<(), TensorFileError> {
    let [domain, target] = Names::pair(shell);
    for (tensor, is_due) in [
        (domain.directions, matches!(way, Way::OntoSphere | Way::ThroughSphere)),
        (target.directions, way == Way::ThroughSphere),
        (domain.positions, way == Way::ThroughTorus),
        (domain.translations, way == Way::ThroughTorus),
        (target.positions, way == Way::ThroughTorus),
        (target.translations, way == Way::ThroughTorus),
        (domain.places, way == Way::ThroughHyperbolicSurface),
        (target.places, way == Way::ThroughHyperbolicSurface),
        (domain.relator, way == Way::ThroughHyperbolicSurface),
    ] {
        if !is_due && reader.has(&tensor) {
            let problem = "does not belong to the kind of boundary map that the metadata name";
            return Err(reader.problem(&tensor, problem.into()));
        }
    }
    Ok(())
}

/// # Errors
///
/// When the file has tensors of more shells than these.
fn require_no_other_shells(reader: &Reader, shells: usize) -> Result<(), TensorFileError> {
    let number = |name: &str| name.strip_prefix("shell")?.split_once('_')?.0.parse::<usize>().ok();
    let names = reader.names().into_iter();
    match names
        .filter(|name| number(name).is_some_and(|shell| shell >= shells))
        .min()
    {
        Some(name) => Err(reader.problem(&name, "is of a shell that the metadata do not name".into())),
        None => Ok(()),
    }
}

/// The map of all shells, or of one, whose way is that of a composition.
fn through_embeddings(
    reader: &Reader,
    way: Way,
    domain: SurfaceMesh,
    target: Option<SurfaceMesh>,
    shell: Option<usize>,
) -> Result<BoundaryMap, TensorFileError> {
    let names = Names::pair(shell);
    let foreign = || {
        let problem = "has a kind of boundary map in the metadata that it cannot have".into();
        reader.problem(&Names::of("domain", None).vertices, problem)
    };
    let made = match (way, target) {
        (Way::OntoSphere, _) => BoundaryMap::onto_sphere(embedding(reader, domain, &names[0])?),
        (Way::ThroughSphere, Some(target)) => BoundaryMap::through_sphere(
            embedding(reader, domain, &names[0])?,
            embedding(reader, target, &names[1])?,
        ),
        (Way::ThroughTorus, Some(target)) => BoundaryMap::through_torus(
            on_torus(reader, domain, &names[0])?,
            on_torus(reader, target, &names[1])?,
        ),
        (Way::ThroughHyperbolicSurface, Some(target)) => BoundaryMap::through_hyperbolic_surface(
            hyperbolic(reader, domain, &names[0])?,
            hyperbolic(reader, target, &names[1])?,
        ),
        _ => return Err(foreign()),
    };
    made.map_err(|e| reader.problem(&Names::of("domain", None).vertices, format!("is unusable: {e}")))
}

fn by_shells(reader: &Reader, domain: &SurfaceMesh, headers: &[ShellHeader]) -> Result<BoundaryMap, TensorFileError> {
    let [of_domain, of_target] = Names::pair(None);
    let target = surface(reader, &of_target)?;
    let shells_of = |surface: &SurfaceMesh, names: &Names| {
        let found = shells_of(surface);
        let (oriented, shells) = found
            .map_err(|e| reader.problem(&names.triangles, format!("has no shells that can be told apart: {e}")))?;
        match &oriented == surface {
            true => Ok(shells),
            false => Err(reader.problem(&names.triangles, "has triangles that face the wrong way".into())),
        }
    };
    let [of_domain, of_target] = [shells_of(domain, &of_domain)?, shells_of(&target, &of_target)?];
    let disagree = || {
        let problem = "has other shells than the metadata say".into();
        reader.problem(&Names::of("domain", None).triangles, problem)
    };
    if headers.len() != of_domain.len() {
        return Err(disagree());
    }
    let mut maps = Vec::new();
    for (shell, (header, own)) in headers.iter().zip(&of_domain).enumerate() {
        let to = of_target.get(header.target).ok_or_else(disagree)?;
        require_no_others(reader, header.way, Some(shell))?;
        let [own, to] = [own, to].map(|shell| shell.surface.clone());
        maps.push(ShellMap {
            target: header.target,
            map: through_embeddings(reader, header.way, own, Some(to), Some(shell))?,
        });
    }
    BoundaryMap::by_shells(domain, &target, maps)
        .map_err(|e| reader.problem(&Names::of("domain", None).vertices, format!("is unusable: {e}")))
}

fn surface(reader: &Reader, names: &Names) -> Result<SurfaceMesh, TensorFileError> {
    SurfaceMesh::new(reader.points(&names.vertices)?, reader.triangles(&names.triangles)?)
        .map_err(|e| reader.problem(&names.triangles, format!("is unusable: {e}")))
}

fn embedding(reader: &Reader, surface: SurfaceMesh, names: &Names) -> Result<SphericalEmbedding, TensorFileError> {
    let directions: Vec<Vector> = reader
        .rows::<3>(&names.directions)?
        .into_iter()
        .map(Vector::from)
        .collect();
    let embedding = SphericalEmbedding::new(surface.clone(), &directions)
        .map_err(|e| reader.problem(&names.directions, format!("is unusable: {e}")))?;
    if let Some(v) = (0..directions.len()).find(|&v| directions[v] != embedding.directions()[v]) {
        let length = directions[v].norm();
        return Err(reader.problem(
            &names.directions,
            format!("has length {length} in row {v} instead of 1"),
        ));
    }
    if embedding.surface() != &surface {
        return Err(reader.problem(&names.triangles, "has triangles that do not face outward".into()));
    }
    Ok(embedding)
}

fn on_torus(reader: &Reader, surface: SurfaceMesh, names: &Names) -> Result<ToroidalEmbedding, TensorFileError> {
    let positions: Vec<[f64; 2]> = reader.rows(&names.positions)?;
    let translations: Vec<[i32; 6]> = reader.integers(&names.translations)?;
    let translations: Vec<_> = translations
        .iter()
        .map(|&[a, b, c, d, e, f]| [[a, b], [c, d], [e, f]])
        .collect();
    let embedding = ToroidalEmbedding::new(surface, &positions, &translations).map_err(|error| {
        let tensor = match error {
            ToroidalError::Translations { .. } => &names.translations,
            _ => &names.positions,
        };
        reader.problem(tensor, format!("is unusable: {error}"))
    })?;
    if let Some(v) = (0..positions.len()).find(|&v| positions[v] != embedding.positions()[v]) {
        let problem = format!("is, in row {v}, no multiple of 2⁻⁴⁸ from 0 to 1");
        return Err(reader.problem(&names.positions, problem));
    }
    Ok(embedding)
}

fn hyperbolic(reader: &Reader, surface: SurfaceMesh, names: &Names) -> Result<HyperbolicEmbedding, TensorFileError> {
    let places: Vec<[f64; 2]> = reader.rows(&names.places)?;
    let lengths: Vec<[i32; 3]> = reader.integers(&names.word_lengths)?;
    let letters = |tensor: &str| -> Result<Vec<Letter>, TensorFileError> {
        let found: Vec<[i32; 1]> = reader.integers(tensor)?;
        let letters = found.iter().map(|&[letter]| Letter::try_from(letter));
        letters
            .collect::<Result<_, _>>()
            .map_err(|_| reader.problem(tensor, "has numbers that are no letters".into()))
    };
    let (relator, letters) = (letters(&names.relator)?, letters(&names.letters)?);
    let mut rest = letters.as_slice();
    let mut next = |length: i32| {
        let (word, others) = rest.split_at_checked(usize::try_from(length).ok()?)?;
        rest = others;
        Some(word.to_vec())
    };
    let of_triangle = |&[a, b, c]: &[i32; 3]| Some([next(a)?, next(b)?, next(c)?]);
    let words: Option<Vec<[Vec<Letter>; 3]>> = lengths.iter().map(of_triangle).collect();
    let words = words.filter(|_| rest.is_empty());
    let words =
        words.ok_or_else(|| reader.problem(&names.word_lengths, "does not fit the number of letters".into()))?;
    HyperbolicEmbedding::new(surface, &relator, &places, &words).map_err(|error| {
        let tensor = match error {
            HyperbolicError::Letters | HyperbolicError::Words { .. } => &names.letters,
            _ => &names.places,
        };
        reader.problem(tensor, format!("is unusable: {error}"))
    })
}

fn require_agreement(reader: &Reader, map: &BoundaryMap, image: &[Point]) -> Result<(), TensorFileError> {
    if map.image().len() != image.len() {
        let problem = format!("has {} rows for {} vertices", image.len(), map.image().len());
        return Err(reader.problem(IMAGE, problem));
    }
    let most = AGREEMENT * map.target_diagonal();
    let distance = |v: usize| (map.image()[v] - image[v]).norm();
    // False for NaN.
    let is_near = |v: usize| distance(v) <= most;
    let Some(v) = (0..image.len()).find(|&v| !is_near(v)) else {
        return Ok(());
    };
    let away = distance(v);
    let problem =
        format!("is {away:e} away, in row {v}, from where the directions send that vertex; the file was changed");
    Err(reader.problem(IMAGE, problem))
}
