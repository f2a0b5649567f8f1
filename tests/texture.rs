//! Solid textures against what is known of them: the picture on the surface, harmonic functions inside.

use std::f64::consts::{PI, TAU};

use crate::common::{interior_points, tets_of};
use solidmap::bijective::BijectiveMap;
use solidmap::boundary_map::{BoundaryMap, BoundaryMapError};
use solidmap::files::{self, TensorFileError, TextureFile, TextureMetadata};
use solidmap::fit::{FitError, FitOptions};
use solidmap::io;
use solidmap::map::HarmonicMap;
use solidmap::mesh::{SurfaceMesh, SurfacePoint, shapes};
use solidmap::sampling::held_out;
use solidmap::texture::{
    ColouredSurface, ExtendedQuantity, LinearRgb, Picture, SolidTexture, TextureError, TextureOptions, VoxelGrid, Wrap,
    from_srgb,
};
use solidmap::{Matrix3, Point};

const SEED: u64 = 5;

fn ball() -> SurfaceMesh {
    shapes::geodesic_sphere(1.0, 14)
}

/// Longitude and latitude: a seam from pole to pole, at which `u` jumps from 1 to 0. In triangles across it `u` exceeds
/// 1.
fn cylindrical(surface: &SurfaceMesh) -> Vec<[[f64; 2]; 3]> {
    let uv = |p: Point| {
        [
            p.y.atan2(p.x).rem_euclid(TAU) / TAU,
            1.0 - (p.z / p.coords.norm()).acos() / PI,
        ]
    };
    let corners = (0..surface.triangles().len()).map(|t| {
        let mut corners = surface.corners(t).map(uv);
        let highest = corners.iter().map(|c| c[0]).fold(0.0, f64::max);
        corners
            .iter_mut()
            .filter(|c| highest - c[0] > 0.5)
            .for_each(|c| c[0] += 1.0);
        corners
    });
    corners.collect()
}

/// A picture of `code(u, v)` at the pixels' centres, from 0 to 1 with `v` upward.
fn painted(side: usize, code: impl Fn(f64, f64) -> [u8; 3]) -> Picture {
    let place = |k: usize| (k as f64 + 0.5) / side as f64;
    let pixels = (0..side * side).map(|i| code(place(i % side), 1.0 - place(i / side)));
    Picture::new(side, side, pixels.collect()).unwrap()
}

/// Waves that are periodic in `u`, with one colour all around each pole.
fn waves() -> Picture {
    painted(256, |u, v| {
        let (turn, rise) = ((TAU * u).cos(), (PI * v).sin());
        [
            (128.0 + 100.0 * turn * rise) as u8,
            (40.0 + 180.0 * v) as u8,
            (128.0 + 100.0 * (2.0 * TAU * u).sin() * rise) as u8,
        ]
    })
}

fn with_picture(surface: &SurfaceMesh, picture: Picture) -> ColouredSurface {
    ColouredSurface::from_picture(surface, cylindrical(surface), picture, Wrap::Repeat).unwrap()
}

fn solid(coloured: ColouredSurface) -> SolidTexture {
    SolidTexture::fit(coloured, &TextureOptions::default(), &|_| {}).unwrap()
}

fn largest_difference(a: &[LinearRgb], b: &[LinearRgb]) -> f64 {
    assert_eq!(a.len(), b.len());
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.map(|(x, y)| (x - y).abs()).fold(0.0, |most, d| {
        assert!(d.is_finite(), "{d}");
        d.max(most)
    })
}

fn colours_of(coloured: &ColouredSurface, points: &[SurfacePoint]) -> (Vec<Point>, Vec<LinearRgb>) {
    let surface = coloured.surface();
    let position = |p: &SurfacePoint| p.position(surface, surface.vertices());
    (
        points.iter().map(position).collect(),
        points.iter().map(|p| coloured.colour(p)).collect(),
    )
}

/// A position is rounded to 1e-16 of the diagonal, which moves its place in a triangle of height 0.05 by 1e-14 and in a
/// picture 1024 pixels wide by 1e-11 of a pixel; light changes by no more than 1 from pixel to pixel.
#[test]
fn the_texture_is_the_picture_on_the_surface() {
    for picture in [waves(), Picture::checker(16).unwrap()] {
        let texture = solid(with_picture(&ball(), picture));
        let (positions, picture) = colours_of(texture.coloured_surface(), &held_out(&ball(), 5000, 0, SEED));
        assert!(largest_difference(&texture.sample(&positions), &picture) < 1e-10);
    }
}

/// Coordinates near 1e8 are rounded to 1e-8, and so are places in triangles whose colours change by 0.5 over a length
/// of 1.
#[test]
fn far_from_the_origin_the_surface_has_its_colours() {
    let near = ball();
    let colours = near.vertices().iter().map(|p| [0.5 + 0.5 * p.x, 0.5, 0.5 - 0.4 * p.z]);
    let colours: Vec<LinearRgb> = colours.collect();
    let moved = near.vertices().iter().map(|p| Point::new(p.x + 1e8, p.y, p.z));
    let far = SurfaceMesh::new(moved.collect(), near.triangles().to_vec()).unwrap();
    let texture = solid(ColouredSurface::from_vertex_colours(&far, colours).unwrap());
    let (positions, painted) = colours_of(
        texture.coloured_surface(),
        &held_out(texture.coloured_surface().surface(), 5000, 0, SEED),
    );
    assert!(largest_difference(&texture.sample(&positions), &painted) < 1e-6);
    let residual = texture.surface_error(5000, SEED).unwrap();
    assert!(residual.max < 1e-6, "{residual:?}");
}

#[test]
fn points_without_colour_miss_the_picture() {
    let texture = solid(with_picture(&ball(), waves()));
    let mut coefficients = texture.map().coefficients().clone();
    coefficients.affine[0][1] = f64::NAN;
    let map = HarmonicMap::new(texture.map().sources().to_vec(), coefficients).unwrap();
    let without = SolidTexture::from_parts(
        texture.coloured_surface().clone(),
        ExtendedQuantity::Colours,
        map,
        texture.report().clone(),
    );
    let without = without.unwrap();
    for residual in [without.surface_error(500, SEED), without.harmonic_error(500, SEED)] {
        let residual = residual.unwrap();
        assert_eq!([residual.rms, residual.p99, residual.max], [f64::INFINITY; 3]);
    }
}

/// Refused before the first triangle is cut: at a billion sources that would take all memory.
#[test]
fn sources_beyond_their_limit_or_memory_are_refused() {
    let refused = |least_sources: usize, max_sources: usize, memory: Option<u64>| {
        let options = TextureOptions {
            least_sources,
            fit: FitOptions {
                max_sources,
                memory,
                ..TextureOptions::default().fit
            },
            ..TextureOptions::default()
        };
        SolidTexture::fit(with_picture(&ball(), waves()), &options, &|_| {}).unwrap_err()
    };
    let error = refused(3001, 3000, None);
    assert!(
        matches!(
            error,
            TextureError::SourceLimit {
                least: 3001,
                most: 3000
            }
        ),
        "{error}"
    );
    for sources in [1_000_000_000, usize::MAX] {
        let error = refused(sources, usize::MAX, Some(1 << 32));
        assert!(matches!(error, TextureError::TooManySources { .. }), "{error}");
    }
}

/// The triangles of a coarse surface are cut, so that there are enough sources for the picture, which the texture still
/// is on the surface.
#[test]
fn coarse_surfaces_get_enough_sources() {
    let cube = shapes::cube(1.0, 1);
    let texture = solid(with_picture(&cube, waves()));
    assert!(texture.map().sources().len() >= 2000);
    let (positions, picture) = colours_of(
        texture.coloured_surface(),
        &held_out(texture.coloured_surface().surface(), 3000, 0, SEED),
    );
    assert!(largest_difference(&texture.sample(&positions), &picture) < 1e-10);
}

/// By the maximum principle the error inside is at most that on the surface, of which the report has a sample: hence
/// twice.
#[test]
fn colours_linear_in_space_are_reproduced_inside() {
    let domain = shapes::bumpy_sphere(16);
    let linear = |p: &Point| {
        [
            0.5 + 0.2 * p.x - 0.1 * p.z,
            0.4 + 0.3 * p.y,
            0.3 - 0.1 * p.x + 0.2 * p.y,
        ]
    };
    let colours = domain.vertices().iter().map(linear).collect();
    let texture = solid(ColouredSurface::from_vertex_colours(&domain, colours).unwrap());
    let on_surface = texture.report().boundary_error.max * 3f64.sqrt();
    assert!(on_surface < 1e-4, "{on_surface}");
    let points = interior_points(&domain, 2000, SEED);
    let expected: Vec<LinearRgb> = points.iter().map(linear).collect();
    let difference = largest_difference(&texture.sample(&points), &expected);
    assert!(difference < 2.0 * on_surface + 1e-9, "{difference}");
}

/// Colours linear in space, in the target of an affine map: those of the analytic preimages, by the tolerance of
/// `colours_linear_in_space_are_reproduced_inside`; on the cube's surface, linear over its triangles, to rounding.
#[test]
fn the_target_of_a_map_has_the_colours_of_preimages() {
    let cube = shapes::cube(2.0, 4);
    let linear = |p: &Point| {
        [
            0.5 + 0.2 * p.x - 0.1 * p.z,
            0.4 + 0.3 * p.y,
            0.3 - 0.1 * p.x + 0.1 * p.y,
        ]
    };
    let colours = cube.vertices().iter().map(linear).collect();
    let texture = solid(ColouredSurface::from_vertex_colours(&cube, colours).unwrap());
    let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
    let mesh = tets_of(&cube, 4);
    let images = mesh.vertices().iter().map(|p| Point::from(matrix * p.coords)).collect();
    let map = BijectiveMap::new(mesh, images).unwrap();
    let carried = |points: &[Point]| -> Vec<Point> { points.iter().map(|p| Point::from(matrix * p.coords)).collect() };
    let inside = interior_points(&cube, 2000, SEED);
    let (found, report) = texture.sample_through(&map, &carried(&inside));
    assert_eq!((report.ok, report.points), (2000, 2000));
    let expected: Vec<LinearRgb> = inside.iter().map(linear).collect();
    let allowed = 2.0 * 3f64.sqrt() * texture.report().boundary_error.max + 1e-9;
    assert!(largest_difference(&found, &expected) < allowed);
    // Rounding puts preimages of points of the surface beyond it; they have colours all the same.
    let (on_surface, expected) = colours_of(texture.coloured_surface(), &held_out(&cube, 5000, 0, SEED));
    let (found, _) = texture.sample_through(&map, &carried(&on_surface));
    assert!(largest_difference(&found, &expected) < 1e-12);
    // In the gap between image and target, the colour of the closest point.
    let beyond = carried(&[Point::new(0.3, 0.2, 1.01)]);
    let (found, _) = texture.sample_through(&map.clone().with_gap(0.1), &beyond);
    assert!(largest_difference(&found, &[linear(&Point::new(0.3, 0.2, 1.0))]) < 0.01);
    let (found, report) = texture.sample_through(&map, &beyond);
    assert!(found[0][0].is_nan() && report.outside == 1);
}

/// Poisson's integral of the picture over the ball. The triangles lie up to h²/8 = 1.5e-3 inside of the sphere (h =
/// 0.11), and the picture's slope is about 2, so that values differ by 3e-3; 200 000 points give the integral to 1e-3.
#[test]
fn inside_a_ball_the_texture_is_poissons_integral() {
    let texture = solid(with_picture(&ball(), waves()));
    let (places, colours) = colours_of(texture.coloured_surface(), &held_out(&ball(), 200_000, 0, SEED));
    let inner: Vec<Point> = interior_points(&ball(), 40, SEED).iter().map(|p| p * 0.6).collect();
    let exact: Vec<LinearRgb> = inner
        .iter()
        .map(|x| {
            let (mut sum, mut total) = ([0.0; 3], 0.0);
            for (y, colour) in places.iter().zip(&colours) {
                let kernel = (x - y.coords.normalize()).coords.norm().powi(-3);
                total += kernel;
                (0..3).for_each(|k| sum[k] += kernel * colour[k]);
            }
            sum.map(|s| s / total)
        })
        .collect();
    let difference = largest_difference(&texture.sample(&inner), &exact);
    assert!(difference < 6e-3, "{difference}");
}

/// The harmonic part overshoots at the edges of squares; the sum is bounded by that, and away from the layer by little.
#[test]
fn colours_inside_are_within_those_of_the_picture() {
    let texture = solid(with_picture(&ball(), Picture::checker(12).unwrap()));
    let (positions, picture) = colours_of(texture.coloured_surface(), &held_out(&ball(), 20_000, 0, SEED));
    let beyond = |colours: &[LinearRgb], k: usize| {
        let (low, high) = picture
            .iter()
            .fold((1.0f64, 0.0f64), |(l, h), c| (l.min(c[k]), h.max(c[k])));
        let outside = colours.iter().map(|c| (low - c[k]).max(c[k] - high));
        outside.fold(0.0, f64::max)
    };
    let inner = interior_points(&ball(), 5000, SEED);
    let deep: Vec<Point> = inner.iter().map(|p| p * 0.75).collect();
    let [on_surface, inside, deep] = [
        texture.harmonic(&positions),
        texture.sample(&inner),
        texture.sample(&deep),
    ];
    for k in 0..3 {
        let most = beyond(&on_surface, k);
        assert!(
            most > 0.02 && beyond(&inside, k) <= 1.1 * most,
            "{most} {}",
            beyond(&inside, k)
        );
        assert!(beyond(&deep, k) < 0.01, "{}", beyond(&deep, k));
    }
}

/// Where the picture is periodic, both sides of a seam meet the same pixels, and `u` differs by 1.
#[test]
fn colours_agree_across_a_seam_that_coordinates_jump_at() {
    let coloured = with_picture(&ball(), waves());
    let seams = coloured.seams();
    // From pole to pole there are 3 · 14 edges or so, and at the poles `u` jumps around.
    assert!((30..120).contains(&seams.seams), "{seams:?}");
    assert!(seams.largest_uv_jump > 0.9);
    assert!(seams.edges == 3 * ball().triangles().len() / 2);
    // At the poles, where all `u` meet, pixels beside the edge of the picture differ a little.
    assert!(seams.rms_colour_jump < 0.02, "{seams:?}");

    // Across the seam, at y = 0 and x > 0, just inside: the texture is as continuous as elsewhere.
    let texture = solid(coloured);
    let pair = |angle: f64| {
        let side = |y: f64| Point::new(0.97 * angle.cos(), y, 0.97 * angle.sin());
        [side(-1e-4), side(1e-4)]
    };
    let pairs: Vec<Point> = (-10..=10).flat_map(|k| pair(0.1 * f64::from(k))).collect();
    let colours = texture.sample(&pairs);
    for two in colours.chunks(2) {
        // Slopes are below 3, and one pixel's code may round the other way: 1/255 of the light or so.
        assert!(largest_difference(&two[..1], &two[1..]) < 2e-4 * 3.0 + 0.01, "{two:?}");
    }
}

#[test]
fn a_picture_that_does_not_match_at_the_seam_is_reported() {
    // A tenth of the picture is unused at either edge, so that u is 0.1 on one side of the seam and 0.9 on the other.
    let ramp = painted(128, |u, _| [(255.0 * u) as u8, 0, 0]);
    let uv = cylindrical(&ball())
        .into_iter()
        .map(|corners| corners.map(|[u, v]| [0.1 + 0.8 * u, v]));
    let apart = ColouredSurface::from_picture(&ball(), uv.collect(), ramp, Wrap::Repeat)
        .unwrap()
        .seams();
    assert!(
        apart.largest_colour_jump > 0.5 && apart.rms_colour_jump > 0.2,
        "{apart:?}"
    );
}

/// Coordinates (x, y), the projection along z, are harmonic: the picture goes straight through. The fit's error, in
/// pixels, moves colours by less than that share of the change of light from pixel to pixel.
#[test]
fn coordinates_without_seams_carry_the_picture_through() {
    let domain = shapes::bumpy_sphere(16);
    let uv = (0..domain.triangles().len()).map(|t| domain.corners(t).map(|p| [0.5 + 0.3 * p.x, 0.5 + 0.3 * p.y]));
    let picture = waves();
    let coloured = ColouredSurface::from_picture(&domain, uv.collect(), picture.clone(), Wrap::Clamp).unwrap();
    let options = TextureOptions {
        extended: ExtendedQuantity::Coordinates,
        ..TextureOptions::default()
    };
    let texture = SolidTexture::fit(coloured, &options, &|_| {}).unwrap();
    let points = interior_points(&domain, 1000, SEED);
    let expected: Vec<LinearRgb> = points
        .iter()
        .map(|p| picture.light([0.5 + 0.3 * p.x, 0.5 + 0.3 * p.y], Wrap::Clamp))
        .collect();
    let moved = 256.0 * texture.report().boundary_error.max;
    let difference = largest_difference(&texture.sample(&points), &expected);
    assert!(difference < 2.0 * moved + 1e-9 && moved < 0.02, "{difference} {moved}");
}

#[test]
fn coordinates_that_jump_are_refused_unless_asked_for() {
    let mut options = TextureOptions {
        extended: ExtendedQuantity::Coordinates,
        ..TextureOptions::default()
    };
    let fit = |coloured: ColouredSurface, options: &TextureOptions| SolidTexture::fit(coloured, options, &|_| {});
    let error = fit(with_picture(&ball(), waves()), &options).unwrap_err();
    assert!(matches!(error, TextureError::Seams { seams: 30.., .. }), "{error}");
    options.across_seams = true;
    assert!(fit(with_picture(&ball(), waves()), &options).is_ok());
    let painted = ColouredSurface::from_vertex_colours(&ball(), vec![[0.5; 3]; ball().vertices().len()]).unwrap();
    assert!(matches!(fit(painted, &options), Err(TextureError::NoUv)));
}

#[test]
fn there_is_no_colour_outside() {
    let texture =
        solid(ColouredSurface::from_vertex_colours(&ball(), vec![[0.25; 3]; ball().vertices().len()]).unwrap());
    let points = [
        Point::origin(),
        Point::new(1.2, 0.0, 0.0),
        Point::new(f64::NAN, 0.0, 0.0),
        Point::new(0.0, f64::INFINITY, 0.0),
        ball().vertices()[3],
    ];
    let colours = texture.sample(&points);
    let has_colour: Vec<bool> = colours
        .iter()
        .map(|c| c.iter().all(|l| (l - 0.25).abs() < 1e-6))
        .collect();
    assert_eq!(has_colour, [true, false, false, false, true]);
    assert!(colours[1..4].iter().flatten().all(|l| l.is_nan()));
    assert!(texture.sample(&[]).is_empty());
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let texture = solid(with_picture(&shapes::geodesic_sphere(1.0, 8), waves()));
            texture.sample(&interior_points(texture.coloured_surface().surface(), 500, SEED))
        })
    };
    // Up to the rounding of the dense coarsest level.
    let [one, three] = [with(1), with(3)];
    assert_eq!(one.len(), three.len());
    assert!(largest_difference(&one, &three) < 1e-9);
}

#[test]
fn a_reversed_surface_has_the_same_colours() {
    let reversed = ball().reversed();
    let [one, other] = [ball(), reversed].map(|surface| solid(with_picture(&surface, waves())));
    let points = interior_points(&ball(), 500, SEED);
    assert!(largest_difference(&one.sample(&points), &other.sample(&points)) < 1e-6);
}

#[test]
fn what_is_stored_is_read_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.safetensors");
    let points = interior_points(&ball(), 300, SEED);
    let painted = ball()
        .vertices()
        .iter()
        .map(|p| [0.5 + 0.5 * p.x, 0.5, 0.5 - 0.4 * p.z])
        .collect();
    for coloured in [
        with_picture(&ball(), waves()),
        ColouredSurface::from_vertex_colours(&ball(), painted).unwrap(),
    ] {
        let texture = solid(coloured);
        let metadata = TextureMetadata::new(texture.report().clone(), vec![]);
        let file = TextureFile { texture, metadata };
        files::write_texture(&path, &file).unwrap();
        let read = files::read_texture(&path).unwrap();
        assert_eq!(read.metadata.fit.sources, file.metadata.fit.sources);
        assert_eq!(read.texture.coloured_surface(), file.texture.coloured_surface());
        assert_eq!(read.texture.sample(&points), file.texture.sample(&points));
    }
    let bytes = std::fs::read(&path).unwrap();
    for length in (0..bytes.len()).step_by(bytes.len() / 40) {
        std::fs::write(&path, &bytes[..length]).unwrap();
        assert!(
            matches!(files::read_texture(&path), Err(TensorFileError::Foreign { .. })),
            "{length}"
        );
    }
}

/// A cube fills its box, and a ball π/6 of it, to within the voxels that its surface passes through: less than 4 layers
/// of a 30th of the side.
#[test]
fn voxels_cover_the_solid() {
    let sky = |surface: &SurfaceMesh| {
        ColouredSurface::from_vertex_colours(surface, vec![from_srgb([90, 160, 230]); surface.vertices().len()])
    };
    let cube = shapes::cube(2.0, 3);
    let grid = VoxelGrid::of(&cube, 10).unwrap();
    assert_eq!((grid.size, grid.voxels()), ([10; 3], 1000));
    let (low, _) = cube.bounding_box().unwrap();
    assert!((grid.centre(0) - low - solidmap::Vector::repeat(0.1)).norm() < 1e-12);
    assert!((grid.centre(999) - low - solidmap::Vector::repeat(1.9)).norm() < 1e-12);
    let volume = solid(sky(&cube).unwrap()).volume(&grid, &|_| {});
    assert_eq!(volume.inside, 1000);
    assert!(volume.rgba.iter().all(|voxel| *voxel == [90, 160, 230, 255]));

    let grid = VoxelGrid::of(&ball(), 30).unwrap();
    let volume = solid(sky(&ball()).unwrap()).volume(&grid, &|_| {});
    let part = volume.inside as f64 / grid.voxels() as f64;
    assert!((part - PI / 6.0).abs() < 0.03, "{part}");
    for (k, voxel) in volume.rgba.iter().enumerate() {
        let distance = grid.centre(k).coords.norm();
        let expected = if distance < 0.99 { [90, 160, 230, 255] } else { [0; 4] };
        assert!(*voxel == expected || (0.99..1.0).contains(&distance), "{k}");
    }
}

#[test]
fn volumes_beyond_memory_are_refused_before_they_are_allocated() {
    for resolution in [10_000_000, usize::MAX] {
        assert!(matches!(
            VoxelGrid::of(&ball(), resolution),
            Err(TextureError::TooLarge { .. })
        ));
    }
    assert!(matches!(VoxelGrid::of(&ball(), 0), Err(TextureError::NoVoxels)));
}

#[test]
fn what_cannot_be_textured_is_refused_with_the_reason() {
    let (surface, uv) = (ball(), cylindrical(&ball()));
    let of = |uv: Vec<[[f64; 2]; 3]>| ColouredSurface::from_picture(&ball(), uv, waves(), Wrap::Repeat);
    assert!(matches!(of(uv[1..].to_vec()), Err(TextureError::UvCount { .. })));
    let mut broken = uv.clone();
    broken[7][1][0] = f64::INFINITY;
    assert!(matches!(of(broken), Err(TextureError::UvNotFinite { triangle: 7 })));
    let colours = vec![[0.5; 3]; surface.vertices().len()];
    assert!(matches!(
        ColouredSurface::from_vertex_colours(&surface, colours[1..].to_vec()),
        Err(TextureError::ColourCount { .. })
    ));
    let mut broken = colours.clone();
    broken[4][2] = f64::NAN;
    assert!(matches!(
        ColouredSurface::from_vertex_colours(&surface, broken),
        Err(TextureError::ColourNotFinite { vertex: 4 })
    ));
    let (vertices, triangles) = surface.into_parts();
    let open = SurfaceMesh::new(vertices, triangles[1..].to_vec()).unwrap();
    let coloured = ColouredSurface::from_vertex_colours(&open, colours).unwrap();
    let error = SolidTexture::fit(coloured, &TextureOptions::default(), &|_| {}).unwrap_err();
    assert!(
        matches!(error, TextureError::Fit(FitError::DefectiveDomain(_))),
        "{error}"
    );
}

/// More sources resolve more of a picture without edges, and refinement goes on to its tolerance.
#[test]
fn the_harmonic_part_improves_with_more_sources() {
    let error = |least_sources: usize| {
        let options = TextureOptions {
            least_sources,
            ..TextureOptions::default()
        };
        let domain = shapes::geodesic_sphere(1.0, 8);
        let texture = SolidTexture::fit(with_picture(&domain, waves()), &options, &|_| {}).unwrap();
        texture.harmonic_error(4000, SEED).unwrap().rms
    };
    let [coarse, fine] = [error(600), error(9000)];
    assert!(fine < 0.5 * coarse, "{coarse} {fine}");
    let options = TextureOptions {
        least_sources: 600,
        fit: FitOptions {
            tolerance: 0.01,
            ..FitOptions::adaptive()
        },
        ..TextureOptions::default()
    };
    let coloured = with_picture(&shapes::geodesic_sphere(1.0, 8), waves());
    let refined = SolidTexture::fit(coloured, &options, &|_| {}).unwrap();
    assert!(refined.report().boundary_error.p99 <= 0.01);
}

/// A function of the points of a surface, asked for after triangles were cut: the same at the same place.
#[test]
fn functions_on_a_boundary_survive_subdivision() {
    let domain = ball();
    let shape = domain.clone();
    let cubic = move |p: &SurfacePoint| {
        let x = p.position(&shape, shape.vertices());
        Point::new(x.x * x.y * x.z, x.x * x.x, x.y - x.z)
    };
    let unit = (Point::origin(), Point::new(1.0, 1.0, 1.0));
    let map = BoundaryMap::by_function(domain.clone(), unit, cubic.clone()).unwrap();
    let twice = map.subdivided().subdivided();
    assert_eq!(twice.target_diagonal(), 3f64.sqrt());
    let points = held_out(twice.domain(), 500, 0, SEED);
    for (x, y) in twice.positions(&points).iter().zip(twice.evaluate(&points)) {
        assert!((Point::new(x.x * x.y * x.z, x.x * x.x, x.y - x.z) - y).norm() < 1e-14);
    }
    assert!(map.over(domain.reversed()).is_err() && map.over(domain.clone()).is_ok());
    let none = BoundaryMap::by_function(domain.clone(), (Point::origin(), Point::origin()), cubic);
    assert!(matches!(none, Err(BoundaryMapError::NoExtent { .. })));
    let undefined = BoundaryMap::by_function(domain, unit, |_| Point::new(f64::NAN, 0.0, 0.0));
    assert!(matches!(undefined, Err(BoundaryMapError::NonFinite { vertex: 0, .. })));
}

#[test]
fn real_models_carry_a_checker_with_seams() {
    let Some(models) = crate::common::models() else { return };
    let read = io::read_textured_surface(models.join("surfaces/spot_uv_2k9.obj")).unwrap();
    let uv = read.uv.unwrap();
    assert_eq!(uv.len(), 5856);
    let coloured =
        ColouredSurface::from_picture(&read.surface, uv, Picture::checker(16).unwrap(), Wrap::Repeat).unwrap();
    let seams = coloured.seams();
    assert!(seams.seams > 200 && seams.largest_colour_jump > 0.5, "{seams:?}");
    let texture = solid(coloured);
    assert!(texture.surface_error(5000, SEED).unwrap().p99 < 1e-10);
    let inner = interior_points(&read.surface, 2000, SEED);
    let colours = texture.sample(&inner);
    assert!(colours.iter().flatten().all(|l| (-0.35..1.35).contains(l)));
}
