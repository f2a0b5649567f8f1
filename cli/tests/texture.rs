//! `solidmap texture` from the command line: a model and a picture in; a volume, pictures, colours and a texture out.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::io::Read;
use std::ops::Deref;
use std::process::Output;

use crate::common::tets_of;
use crate::workplace::{Workplace, text};
use base64::{Engine, engine::general_purpose::STANDARD};
use serde_json::Value;
use solidmap::io;
use solidmap::mesh::{CellMesh, SurfaceMesh, shapes};
use solidmap::{Matrix3, Point};

struct TexturePlace {
    place: Workplace,
}

impl Deref for TexturePlace {
    type Target = Workplace;

    fn deref(&self) -> &Workplace {
        &self.place
    }
}

impl TexturePlace {
    /// A ball with longitude and latitude as texture coordinates, and a picture of waves.
    fn new() -> Self {
        let place = Self {
            place: Workplace::new(),
        };
        place.write("ball.obj", &with_uv(&shapes::geodesic_sphere(1.0, 10)));
        place.picture("waves.png", 64, |u, v| {
            [
                (128.0 + 100.0 * (TAU * u).cos() * (PI * v).sin()) as u8,
                (40.0 + 180.0 * v) as u8,
                90,
            ]
        });
        place
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn picture(&self, name: &str, side: usize, code: impl Fn(f64, f64) -> [u8; 3]) {
        let place = |k: usize| (k as f64 + 0.5) / side as f64;
        let pixels: Vec<u8> = (0..side * side)
            .flat_map(|i| code(place(i % side), 1.0 - place(i / side)))
            .collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, side as u32, side as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        std::fs::write(self.path(name), bytes).unwrap();
    }

    /// Runs `solidmap texture` in the folder.
    fn ends_with(&self, code: i32, line: &str) -> Output {
        self.place.ends_with(code, &format!("texture {line}"))
    }

    fn refuses(&self, line: &str, words: &[&str]) {
        let output = self.ends_with(2, line);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(words.iter().all(|word| said.contains(word)), "{line}: {said}");
        assert!(said.starts_with("error: ") || said.contains("\nerror: "), "{said}");
    }

    fn report(&self, line: &str) -> Value {
        serde_json::from_slice(&self.ends_with(0, line).stdout).unwrap()
    }
}

fn with_uv(surface: &SurfaceMesh) -> String {
    let mut text = String::new();
    for p in surface.vertices() {
        writeln!(text, "v {:?} {:?} {:?}", p.x, p.y, p.z).unwrap();
    }
    for (t, triangle) in surface.triangles().iter().enumerate() {
        let mut corners = surface.corners(t).map(|p: Point| {
            [
                p.y.atan2(p.x).rem_euclid(TAU) / TAU,
                1.0 - p.z.clamp(-1.0, 1.0).acos() / PI,
            ]
        });
        let highest = corners.iter().map(|c| c[0]).fold(0.0, f64::max);
        corners
            .iter_mut()
            .filter(|c| highest - c[0] > 0.5)
            .for_each(|c| c[0] += 1.0);
        corners
            .iter()
            .for_each(|[u, v]| writeln!(text, "vt {u:?} {v:?}").unwrap());
        let [a, b, c] = triangle.map(|v| v + 1);
        let first = 3 * t + 1;
        writeln!(text, "f {a}/{first} {b}/{} {c}/{}", first + 1, first + 2).unwrap();
    }
    text
}

/// What a file of image data holds, read without the library: sizes, origin, spacing and bytes.
struct ImageData {
    size: [usize; 3],
    origin: Vec<f64>,
    spacing: Vec<f64>,
    bytes: Vec<u8>,
}

fn read_vti(text: &str) -> ImageData {
    let attribute = |name: &str| {
        let rest = text.split(&format!("{name}=\"")).nth(1).unwrap();
        rest.split('"').next().unwrap()
    };
    let numbers = |name: &str| {
        attribute(name)
            .split(' ')
            .map(|x| x.parse().unwrap())
            .collect::<Vec<f64>>()
    };
    let extent = numbers("WholeExtent");
    assert_eq!(attribute("compressor"), "vtkZLibDataCompressor");
    assert_eq!((attribute("Scalars"), attribute("NumberOfComponents")), ("rgba", "4"));
    let array = text
        .split("format=\"binary\">")
        .nth(1)
        .unwrap()
        .split('<')
        .next()
        .unwrap();
    let words = |bytes: &[u8]| -> Vec<usize> {
        bytes
            .chunks_exact(8)
            .map(|b| u64::from_le_bytes(b.try_into().unwrap()) as usize)
            .collect()
    };
    let blocks = words(&STANDARD.decode(&array[..12]).unwrap()[..8])[0];
    let header = (3 + blocks) * 8;
    let (header, data) = array.split_at(header.div_ceil(3) * 4);
    let sizes = words(&STANDARD.decode(header).unwrap());
    let data = STANDARD.decode(data).unwrap();
    let (mut bytes, mut start) = (Vec::new(), 0);
    for size in &sizes[3..] {
        flate2::read::ZlibDecoder::new(&data[start..start + size])
            .read_to_end(&mut bytes)
            .unwrap();
        start += size;
    }
    assert_eq!(start, data.len());
    assert_eq!(
        bytes.len(),
        (blocks - 1) * sizes[1] + if sizes[2] > 0 { sizes[2] } else { sizes[1] }
    );
    ImageData {
        size: [1, 3, 5].map(|k| extent[k] as usize + 1),
        origin: numbers("Origin"),
        spacing: numbers("Spacing"),
        bytes,
    }
}

#[test]
fn volume_points_picture_and_texture_file_agree() {
    let place = TexturePlace::new();
    // Centres of voxels of the volume, and a point outside.
    place.write(
        "points.csv",
        "x,y,z\n0.025,0.025,0.025\n-0.475,0.325,0.125\n0.825,-0.025,0.075\n3,0,0\n",
    );
    let report = place.report(
        "ball.obj --image waves.png -o ball.vti --resolution 40 --png ball.png --map ball.safetensors \
         --at points.csv --colours colours.csv --json",
    );
    assert!(report["surface_error"]["max"].as_f64().unwrap() < 1e-9);
    assert!(report["harmonic_error"]["rms"].as_f64().unwrap() < 0.05);
    assert!(report["seams"]["seams"].as_u64().unwrap() > 20);
    assert!(report["seams"]["rms_colour_jump"].as_f64().unwrap() < 0.02);
    assert_eq!(report["points"]["outside"], 1);

    let image = read_vti(&std::fs::read_to_string(place.path("ball.vti")).unwrap());
    assert_eq!(serde_json::json!(image.size), report["volume"]["size"]);
    assert_eq!(image.bytes.len(), 4 * image.size.iter().product::<usize>());
    let inside = image.bytes.chunks(4).filter(|voxel| voxel[3] == 255).count();
    assert_eq!(report["volume"]["inside"], inside);
    let table = std::fs::read_to_string(place.path("colours.csv")).unwrap();
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("x,y,z,red,green,blue"));
    for line in lines {
        let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        if row[0] == 3.0 {
            assert!(row[3..].iter().all(|c| c.is_nan()));
            continue;
        }
        // The nearest voxel is within half its size, in which waves of this length change by a few codes.
        let step = |k: usize| ((row[k] - image.origin[k]) / image.spacing[k]).round() as usize;
        let voxel = step(0) + image.size[0] * (step(1) + image.size[1] * step(2));
        for k in 0..3 {
            let code = f64::from(image.bytes[4 * voxel + k]);
            assert!((code - 255.0 * row[3 + k]).abs() < 8.0, "{row:?} {code}");
        }
    }
    assert!(std::fs::read(place.path("ball.png")).unwrap().starts_with(b"\x89PNG"));

    // The texture file gives the same colours without the model and the picture.
    place.ends_with(0, "ball.safetensors --at points.csv --colours again.csv");
    let again = std::fs::read_to_string(place.path("again.csv")).unwrap();
    assert_eq!(again, table);
    for option in [
        "--checker",
        "--wrap clamp",
        "--sources 3000",
        "--max-sources 3000",
        "--tolerance 0.1",
    ] {
        let name = option.split(' ').next().unwrap();
        place.refuses(
            &format!("ball.safetensors {option} -o x.vti"),
            &["is a texture already", name],
        );
    }
}

/// Triangles across the seam reach beyond the picture; what is there is in the file.
#[test]
fn a_stored_texture_keeps_what_is_beyond_its_picture() {
    let place = TexturePlace::new();
    for line in [
        "ball.obj --checker 8 --wrap clamp --map clamped.safetensors",
        "clamped.safetensors --at ball.obj --colours x.csv",
    ] {
        let said = String::from_utf8(place.ends_with(0, line).stderr).unwrap();
        assert!(said.contains("continues with the colours of its edges"), "{said}");
    }
}

#[test]
fn outputs_are_refused_before_the_fit() {
    let place = TexturePlace::new();
    place.write("points.csv", "x,y,z\n0,0,0\n");
    let tets = "# vtk DataFile Version 3.0\ntet\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n0 0 0 1 0 0 0 1 0 0 0 1\n\
         CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n";
    place.write("tet.vtk", tets);
    let refused = [
        ("--at none.csv --colours x.csv", "none.csv"),
        ("--at points.csv --colours x.vtu", "points without a mesh"),
        ("--at tet.vtk --colours x.ply", "holds tetrahedra"),
        ("-o x.vti --resolution 0", "at least one voxel"),
        ("-o x.vti --resolution 100000000", "GiB"),
    ];
    for (line, word) in refused {
        place.refuses(&format!("ball.obj --checker --map x.safetensors {line}"), &[word]);
        assert!(!place.path("x.safetensors").exists(), "{line}");
    }
}

#[test]
fn colours_are_written_to_meshes() {
    let place = TexturePlace::new();
    place.ends_with(0, "ball.obj --checker 8 --at ball.obj --colours ball.ply");
    let ply = std::fs::read(place.path("ball.ply")).unwrap();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 1002\nproperty double x\nproperty double y\n\
                  property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n\
                  element face 2000\n";
    assert!(
        ply.starts_with(header.as_bytes()),
        "{}",
        String::from_utf8_lossy(&ply[..header.len()])
    );
    let read = solidmap::io::read_surface(place.path("ball.ply")).unwrap();
    assert_eq!((read.vertices().len(), read.triangles().len()), (1002, 2000));
    place.ends_with(0, "ball.obj --checker 8 --at ball.obj --colours ball.vtu");
    assert!(solidmap::io::read_surface(place.path("ball.vtu")).is_ok());
    place.write("points.csv", "x,y,z\n0,0,0\n");
    place.refuses(
        "ball.obj --checker 8 --at points.csv --colours points.vtu",
        &["points without a mesh"],
    );
}

#[test]
fn coloured_vertices_need_no_picture() {
    let place = TexturePlace::new();
    let ball = shapes::geodesic_sphere(1.0, 8);
    let mut text = String::new();
    for p in ball.vertices() {
        writeln!(text, "v {} {} {} {} 0.5 0.25", p.x, p.y, p.z, 0.5 + 0.5 * p.x).unwrap();
    }
    ball.triangles()
        .iter()
        .for_each(|t| writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap());
    place.write("painted.obj", &text);
    let report = place.report("painted.obj -o painted.vti --resolution 8 --json");
    assert_eq!(report["seams"]["seams"], 0);
    let image = read_vti(&std::fs::read_to_string(place.path("painted.vti")).unwrap());
    for voxel in image.bytes.chunks(4).filter(|voxel| voxel[3] > 0) {
        assert!(voxel[1].abs_diff(128) <= 1 && voxel[2].abs_diff(64) <= 1, "{voxel:?}");
    }
    place.refuses(
        "painted.obj --wrap clamp -o x.vti",
        &["--wrap", "painted.obj", "vertices"],
    );
    place.write("bytes.obj", &text.replace(" 0.5 0.25", " 128 64"));
    place.refuses(
        "bytes.obj -o x.vti",
        &["bytes.obj", "vertex 0", "128 64", "divide", "255"],
    );
}

#[test]
fn refusals_name_the_file_and_the_way_out() {
    let place = TexturePlace::new();
    place.refuses(
        "--checker ball.obj",
        &["`ball.obj` is not a number of squares", "name a model before"],
    );
    place.refuses("ball.obj --checker", &["nothing would be written", "--png"]);
    place.refuses("ball.obj --checker -o ball.txt", &["ball.txt", ".vti"]);
    place.refuses("ball.obj -o x.vti", &["ball.obj", "--image", "--checker"]);
    place.refuses("ball.obj --image none.png -o x.vti", &["none.png"]);
    place.write("text.png", "no picture");
    place.refuses("ball.obj --image text.png -o x.vti", &["text.png", "PNG or JPEG"]);
    place.write("empty.png", "");
    place.refuses("ball.obj --image empty.png -o x.vti", &["empty.png"]);
    place.refuses(
        "ball.obj --checker --resolution 100000000 -o x.vti",
        &["100000000", "GiB"],
    );
    place.refuses("ball.obj --checker --resolution 0 -o x.vti", &["at least one voxel"]);
    place.refuses("ball.obj --checker --uv -o x.vti", &["jump", "--across-seams"]);
    place.refuses("ball.obj --checker 0 -o x.vti", &["squares"]);
    place.refuses(
        "ball.obj --checker --sources 200000 -o x.vti",
        &["200000", "--max-sources", "100000"],
    );
    let plain = place.path("plain.obj");
    solidmap::io::write_surface(&plain, &shapes::cube(1.0, 2)).unwrap();
    place.refuses(
        "plain.obj --checker -o x.vti",
        &["plain.obj", "no texture coordinates", "unwrap"],
    );
    place.refuses("plain.obj -o x.vti", &["neither texture coordinates nor colours"]);
    let ball = std::fs::read_to_string(place.path("ball.obj")).unwrap();
    let open: Vec<&str> = ball.lines().take(ball.lines().count() - 1).collect();
    place.write("open.obj", &open.join("\n"));
    place.refuses("open.obj --checker -o x.vti", &["open.obj", "does not bound a solid"]);
    assert!(!place.path("x.vti").exists());
}

#[test]
fn a_missed_tolerance_is_a_failed_check() {
    let place = TexturePlace::new();
    let line = "ball.obj --checker 16 --tolerance 1e-4 --max-sources 3000 -o x.vti --resolution 8";
    let output = place.ends_with(1, line);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains("--max-sources") && said.contains("of the colour cube"),
        "{said}"
    );
    assert!(place.path("x.vti").exists());
    let output = place.ends_with(1, &format!("{line} --uv --across-seams"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("of the box of texture coordinates"), "{said}");
}

/// A cube with coloured vertices, `painted.obj`, and `both.map`, the harmonic and the bijective map by [`affine`].
fn painted_cube() -> TexturePlace {
    let place = TexturePlace {
        place: Workplace::new(),
    };
    let cube = shapes::cube(2.0, 4);
    let mut text = String::new();
    for p in cube.vertices() {
        let [r, g, b] = [p.x, p.y, p.z].map(|x| 0.5 + 0.45 * x);
        writeln!(text, "v {} {} {} {r} {g} {b}", p.x, p.y, p.z).unwrap();
    }
    let faces = cube.triangles().iter().map(|t| t.map(|v| v + 1));
    faces.for_each(|[a, b, c]| writeln!(text, "f {a} {b} {c}").unwrap());
    place.write("painted.obj", &text);
    place.surface("cube.obj", &cube);
    place.surface("target.obj", &shapes::deformed(&cube, affine));
    io::write_cell_mesh(place.path("cube.mesh"), &CellMesh::from(tets_of(&cube, 4))).unwrap();
    place.place.ends_with(0, "fit cube.obj --image target.obj -o cube.map");
    place
        .place
        .ends_with(0, "bijective cube.map --mesh cube.mesh -o both.map");
    place.ends_with(0, "painted.obj --map painted.safetensors");
    place
}

fn matrix() -> Matrix3 {
    Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1)
}

fn affine(p: &Point) -> Point {
    Point::from(matrix() * p.coords) + solidmap::Vector::new(4.0, 0.0, -1.0)
}

fn write_points(place: &TexturePlace, name: &str, points: &[Point]) {
    let values: Vec<f64> = points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    io::write_npy(place.path(name), 3, &values).unwrap();
}

/// Codes from 0 to 255 of a table of colours; `None` where there is none.
fn codes(place: &TexturePlace, name: &str) -> Vec<Option<[f64; 3]>> {
    let rows = io::read_points(place.path(name)).unwrap();
    let code = |p: &Point| (!p.x.is_nan()).then(|| [p.x, p.y, p.z].map(|c| (255.0 * c).round()));
    rows.iter().map(code).collect()
}

/// Colours that are a code apart count as the same: preimages are within 1e-10 of the diagonal.
#[test]
fn the_target_of_a_map_has_the_colours_of_the_analytic_preimages() {
    let place = painted_cube();
    let inside: Vec<Point> = (0..300)
        .map(|k| Point::from([1.7, 2.3, 3.1].map(|f| 0.99 * (f * f64::from(k)).sin())))
        .collect();
    let mut carried: Vec<Point> = inside.iter().map(affine).collect();
    carried.push(affine(&Point::new(1.5, 0.0, 0.0)));
    write_points(&place, "inside.npy", &inside);
    write_points(&place, "carried.npy", &carried);
    place.ends_with(0, "painted.safetensors --at inside.npy --colours expected.npy");
    let expected = codes(&place, "expected.npy");
    for (options, kind) in [
        ("", "bijective"),
        ("--through-kind harmonic", "harmonic"),
        ("--through-kind bijective", "bijective"),
    ] {
        let report = place.report(&format!(
            "painted.safetensors --through both.map {options} --at carried.npy --colours found.npy -o target.vti \
             --resolution 14 --json"
        ));
        let through = &report["through"];
        assert_eq!(
            (&through["map"], &through["map_kind"]),
            (&"both.map".into(), &kind.into())
        );
        assert_eq!((&through["folded"], &through["not_found"]), (&0.into(), &0.into()));
        assert_eq!(report["points"]["outside"], 1);
        let found = codes(&place, "found.npy");
        assert!(found[300].is_none());
        for (a, b) in expected.iter().zip(&found) {
            let (a, b) = (a.unwrap(), b.unwrap());
            assert!((0..3).all(|k| (a[k] - b[k]).abs() <= 1.0), "{kind}: {a:?} {b:?}");
        }

        // Voxels of the target's box, those whose preimage is in the cube with its colour.
        let image = read_vti(&std::fs::read_to_string(place.path("target.vti")).unwrap());
        let inverse = matrix().try_inverse().unwrap();
        let [width, height, depth] = image.size;
        let centres = (0..width * height * depth).map(|k| {
            let steps = [k % width, k / width % height, k / width / height];
            let centre = Point::from([0, 1, 2].map(|i| image.origin[i] + steps[i] as f64 * image.spacing[i]));
            Point::from(inverse * (centre - affine(&Point::origin())))
        });
        let preimages: Vec<Point> = centres.collect();
        write_points(&place, "preimages.npy", &preimages);
        place.ends_with(0, "painted.safetensors --at preimages.npy --colours voxels.npy");
        let mut inside = 0u32;
        for ((voxel, p), code) in image.bytes.chunks(4).zip(&preimages).zip(codes(&place, "voxels.npy")) {
            if (p.coords.amax() - 1.0).abs() < 1e-6 {
                continue;
            }
            assert_eq!(voxel[3], if p.coords.amax() < 1.0 { 255 } else { 0 }, "{kind} {p}");
            if let Some(code) = code {
                assert!(
                    (0..3).all(|k| (code[k] - f64::from(voxel[k])).abs() <= 1.0),
                    "{kind} {p} {voxel:?}"
                );
                inside += 1;
            }
        }
        // The volume of the target in voxels, to a layer of them at most: the target is some twelve voxels wide.
        let expected = 8.0 * matrix().determinant() / image.spacing[0].powi(3);
        assert!((f64::from(inside) / expected - 1.0).abs() < 0.15, "{inside} {expected}");
        assert!(report["volume"]["inside"].as_u64().unwrap() >= inside.into());
    }
    // Vertices of the target's surface have the colours of the model's.
    place.ends_with(
        0,
        "painted.safetensors --through both.map --at target.obj --colours target.npy",
    );
    place.ends_with(0, "painted.safetensors --at cube.obj --colours cube.npy");
    for (a, b) in codes(&place, "cube.npy").iter().zip(codes(&place, "target.npy")) {
        let (a, b) = (a.unwrap(), b.unwrap());
        assert!((0..3).all(|k| (a[k] - b[k]).abs() <= 1.0), "{a:?} {b:?}");
    }
    let said = text(
        &place
            .ends_with(0, "painted.safetensors --through both.map -o x.vti --resolution 4")
            .stdout,
    );
    assert!(said.contains("`both.map`, bijective"), "{said}");
}

#[test]
fn a_texture_is_carried_by_maps_of_its_own_solid_only() {
    let place = painted_cube();
    place.surface("small.obj", &shapes::cube(1.9, 4));
    place
        .place
        .ends_with(0, "fit small.obj --image target.obj -o small.map");
    place.refuses(
        "painted.safetensors --through small.map -o x.vti",
        &["painted.safetensors", "small.map", "is not the domain"],
    );
    // The same cube, meshed differently.
    place.surface("coarse.obj", &shapes::cube(2.0, 2));
    place.surface("coarse_target.obj", &shapes::deformed(&shapes::cube(2.0, 2), affine));
    place
        .place
        .ends_with(0, "fit coarse.obj --image coarse_target.obj -o coarse.map");
    place.ends_with(0, "painted.safetensors --through coarse.map -o x.vti --resolution 4");
    place.refuses(
        "painted.safetensors --through cube.map --through-kind bijective -o x.vti",
        &["holds no bijective map", "solidmap bijective cube.map"],
    );
    place.refuses(
        "painted.safetensors --through cube.map --png x.png",
        &["--png and --html show the model itself", "--through"],
    );
    place.refuses("painted.safetensors --through cube.map", &["nothing would be written"]);
    place.refuses(
        "painted.safetensors --through cube.map --map x.safetensors",
        &["-o", "--at"],
    );
    place.refuses("painted.safetensors --through-kind harmonic -o x.vti", &["--through"]);
    place.refuses("painted.safetensors --through none.map -o x.vti", &["none.map"]);
}

/// The map of a ball onto one half of it folds: its points have two preimages.
#[test]
fn folds_of_a_map_are_counted_and_fail() {
    let place = TexturePlace::new();
    let ball = io::read_surface(place.path("ball.obj")).unwrap();
    place.surface(
        "folded.obj",
        &shapes::deformed(&ball, |p| Point::new(p.x.abs() + 0.1 * p.x, p.y, p.z)),
    );
    place
        .place
        .run("fit ball.obj --image folded.obj -o folded.map --tolerance 0.1");
    let output = place.ends_with(
        1,
        "ball.obj --checker 4 --through folded.map -o folded.vti --resolution 8 --json",
    );
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["through"]["folded"].as_u64().unwrap() > 0, "{report}");
    assert!(
        text(&output.stderr).contains("solidmap bijective"),
        "{}",
        text(&output.stderr)
    );
}
