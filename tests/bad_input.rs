//! Files and surfaces that are wrong in every way thought of, and in those that the fuzzer found: an error that names the
//! file or a result, within seconds, and never a panic or memory for what a file merely promises.

mod common;
#[path = "common/small_files.rs"]
mod small_files;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng, rngs::StdRng};
use small_files::{Format, SmallFile, small_files};
use solidmap::io;

const SEED: u64 = 7;
/// What a read may take, and a check.
const LONGEST: Duration = Duration::from_secs(10);
/// What reading a file of a few kilobytes may hold at a time, in bytes. Pictures take most: 8256 pixels to a byte.
const MOST_MEMORY: usize = 64 << 20;

/// Counts what each thread holds.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    let _ = HELD.try_with(|held| {
        held.set(held.get() + bytes);
        let _ = PEAK.try_with(|peak| peak.set(peak.get().max(held.get())));
    });
}

// SAFETY: everything is left to the system's allocator; the counters allocate nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as isize - layout.size() as isize);
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Reads a file as all that it could be; the messages of what went wrong.
fn messages(format: Format, path: &Path) -> Vec<String> {
    fn said<T, E: Error>(result: Result<T, E>) -> Option<String> {
        result.err().map(|error| error.to_string())
    }
    let all = match format {
        Format::Csv | Format::Npy => vec![said(io::read_points(path)), said(io::read_fields(path))],
        Format::Landmarks => vec![
            said(io::read_landmarks(path, 20, 1000)),
            said(io::read_landmark_files(path, path, 1000, 20)),
        ],
        Format::Map => vec![said(io::read_map(path))],
        Format::Boundary => vec![said(io::read_boundary(path))],
        Format::Texture => vec![said(io::read_texture(path))],
        Format::Picture => vec![said(io::read_picture(path))],
        Format::Obj => vec![said(io::read_solid(path)), said(io::read_textured_surface(path))],
        _ => vec![
            said(io::read_solid(path)),
            said(io::read_cells(path)),
            said(io::read_fields(path)),
        ],
    };
    all.into_iter().flatten().collect()
}

/// A folder in which one file after the other is tried.
struct Trial {
    folder: tempfile::TempDir,
}

impl Trial {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { folder }
    }

    /// Writes and reads these bytes; the messages, each of which names the file.
    fn read(&self, format: Format, bytes: &[u8]) -> Vec<String> {
        let path = self.folder.path().join(format!("spoiled.{}", format.extension()));
        std::fs::write(&path, bytes).unwrap();
        let shown = || bytes[..bytes.len().min(6000)].escape_ascii().to_string();
        let before = HELD.get();
        PEAK.set(before);
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| messages(format, &path)));
        let Ok(messages) = result else {
            panic!("{format:?} panics: {}", shown())
        };
        let taken = PEAK.get() - before;
        assert!(
            taken < MOST_MEMORY as isize,
            "{format:?} takes {taken} bytes: {}",
            shown()
        );
        let seconds = start.elapsed();
        assert!(seconds < LONGEST, "{format:?} takes {seconds:?}: {}", shown());
        for message in &messages {
            assert!(message.contains("spoiled."), "no file is named: {message}");
            // What a terminal would obey is shown, not sent.
            let is_plain = message.len() < 1500 && !message.chars().any(char::is_control);
            assert!(is_plain, "{message:?}");
        }
        messages
    }

    fn read_like(&self, file: &SmallFile, bytes: &[u8]) -> Vec<String> {
        self.read(file.format, bytes)
    }
}

/// At most so many numbers below `end`, evenly.
fn some_of(end: usize, most: usize) -> impl Iterator<Item = usize> {
    (0..end).step_by(end.div_ceil(most).max(1))
}

#[test]
fn small_files_are_read() {
    let trial = Trial::new();
    for file in small_files() {
        let messages = trial.read_like(&file, &file.bytes);
        let count = match file.format {
            // As pairs or as single numbers, not both; two or one of solid, cells and fields.
            Format::Landmarks => 1,
            format if format.is_mesh() && format != Format::Obj => 2,
            _ => 0,
        };
        assert!(messages.len() <= count, "{} {:?}: {messages:?}", file.name, file.format);
    }
}

#[test]
fn cut_files_are_read_or_refused() {
    let trial = Trial::new();
    for file in small_files() {
        for length in some_of(file.bytes.len(), 400) {
            trial.read_like(&file, &file.bytes[..length]);
        }
    }
}

#[test]
fn flipped_bits_are_read_or_refused() {
    let trial = Trial::new();
    let mut random = StdRng::seed_from_u64(SEED);
    for file in small_files() {
        for _ in 0..400 {
            let mut bytes = file.bytes.clone();
            for _ in 0..random.random_range(1..6) {
                let at = random.random_range(0..bytes.len());
                bytes[at] ^= 1 << random.random_range(0..8);
            }
            trial.read_like(&file, &bytes);
        }
    }
}

#[test]
fn absurd_binary_numbers_are_read_or_refused() {
    let trial = Trial::new();
    let patterns: [&[u8]; 8] = [
        &[0xff; 4],
        &[0xff; 8],
        &[0xff, 0xff, 0xff, 0x7f],
        &[0x7f, 0xff, 0xff, 0xff],
        &[0; 8],
        &[0, 0, 0, 0, 0, 0, 0, 0x80],
        &[0, 0, 0, 0, 0, 0, 0xf8, 0x7f],
        &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xef, 0x7f],
    ];
    for file in small_files() {
        for at in some_of(file.bytes.len(), 250) {
            for pattern in patterns {
                let mut bytes = file.bytes.clone();
                let end = (at + pattern.len()).min(bytes.len());
                bytes[at..end].copy_from_slice(&pattern[..end - at]);
                trial.read_like(&file, &bytes);
            }
        }
    }
}

#[test]
fn absurd_numbers_in_text_are_read_or_refused() {
    const ABSURD: [&str; 16] = [
        "18446744073709551615",
        "9223372036854775808",
        "-9223372036854775808",
        "99999999999999999999999999",
        "4294967295",
        "2147483648",
        "1000000000",
        "-1",
        "0",
        "1e300",
        "1e-300",
        "-1e999",
        "nan",
        "inf",
        "",
        "\u{fffd}",
    ];
    let trial = Trial::new();
    for file in small_files() {
        let numbers = numbers_in(&file.bytes);
        for k in some_of(numbers.len(), 60) {
            let (begin, end) = numbers[k];
            for absurd in ABSURD {
                let bytes = [&file.bytes[..begin], absurd.as_bytes(), &file.bytes[end..]].concat();
                trial.read_like(&file, &bytes);
            }
        }
    }
}

/// Where digits begin and end.
fn numbers_in(bytes: &[u8]) -> Vec<(usize, usize)> {
    let is_digit = |k: usize| bytes.get(k).is_some_and(|b| b.is_ascii_digit());
    let begins = (0..bytes.len()).filter(|&k| is_digit(k) && (k == 0 || !is_digit(k - 1)));
    begins
        .map(|k| (k, (k..).find(|&k| !is_digit(k)).unwrap_or(k)))
        .collect()
}

#[test]
fn lines_gone_twice_and_swapped_are_read_or_refused() {
    let trial = Trial::new();
    let mut random = StdRng::seed_from_u64(SEED);
    for file in small_files() {
        let lines: Vec<&[u8]> = file.bytes.split_inclusive(|&b| b == b'\n').collect();
        for k in some_of(lines.len(), 100) {
            let mut gone = lines.clone();
            gone.remove(k);
            trial.read_like(&file, &gone.concat());
            let mut twice = lines.clone();
            twice.insert(k, lines[k]);
            trial.read_like(&file, &twice.concat());
            let mut swapped = lines.clone();
            swapped.swap(k, random.random_range(0..lines.len()));
            trial.read_like(&file, &swapped.concat());
            let doubled = [lines[k].trim_ascii_end(), b" ", lines[k]].concat();
            let mut longer = lines.clone();
            longer[k] = &doubled;
            trial.read_like(&file, &longer.concat());
        }
    }
}

#[test]
fn words_of_other_kinds_are_read_or_refused() {
    let trial = Trial::new();
    let mut random = StdRng::seed_from_u64(SEED);
    for file in small_files() {
        let words: Vec<&[u8]> = file.bytes.split_inclusive(|b| b.is_ascii_whitespace()).collect();
        for _ in 0..200 {
            let mut mixed = words.clone();
            for _ in 0..random.random_range(1..4) {
                mixed[random.random_range(0..words.len())] = words[random.random_range(0..words.len())];
            }
            trial.read_like(&file, &mixed.concat());
        }
    }
}

#[test]
fn odd_bytes_and_line_ends_are_read_or_refused() {
    let trial = Trial::new();
    for file in small_files() {
        let bytes = &file.bytes;
        let replaced = |with: &[u8]| bytes.split(|&b| b == b'\n').collect::<Vec<_>>().join(with);
        let with_text = trial.read_like(&file, bytes);
        let crlf = trial.read_like(&file, &replaced(b"\r\n"));
        let is_text = bytes.is_ascii() && !bytes.contains(&0);
        if is_text {
            assert_eq!(crlf.len(), with_text.len(), "{} {:?}: {crlf:?}", file.name, file.format);
        }
        for odd in [
            replaced(b"\r"),
            replaced(b"\n\n\n"),
            replaced(b"\0\n"),
            replaced(b"\xff\xfe\n"),
            [b"\xef\xbb\xbf", bytes.as_slice()].concat(),
            // As UTF-16.
            bytes.iter().flat_map(|&b| [b, 0]).collect(),
            [bytes.as_slice(), bytes].concat(),
            [bytes.as_slice(), &[0; 100]].concat(),
            [&[0; 100], bytes.as_slice()].concat(),
            bytes.iter().rev().copied().collect(),
            bytes.to_ascii_uppercase(),
        ] {
            trial.read_like(&file, &odd);
        }
        for nothing in [
            &b""[..],
            b"\n",
            b" \t\r\n",
            b"\0",
            &[0; 1000],
            &[0xff; 1000],
            b"\xef\xbb\xbf",
        ] {
            let messages = trial.read_like(&file, nothing);
            let is_allowed = file.format == Format::Obj && messages.len() == 1;
            assert!(
                !messages.is_empty() || is_allowed,
                "{:?} of nothing: {messages:?}",
                file.format
            );
        }
    }
}

#[test]
fn files_of_one_kind_named_as_another_are_refused() {
    let trial = Trial::new();
    let files = small_files();
    for file in &files {
        for other in files.iter().filter(|other| other.format != file.format) {
            trial.read(other.format, &file.bytes);
        }
    }
}

mod surfaces {
    use super::*;
    use solidmap::Point;
    use solidmap::check::{CheckReport, check, close_holes, mend};
    use solidmap::mesh::{SurfaceMesh, shapes};

    /// Everything the doctor does, in time.
    fn examined(name: &str, surface: &SurfaceMesh) -> CheckReport {
        let start = Instant::now();
        let report = check(surface, None);
        let _ = report.to_string();
        eprintln!(
            "{name}: {} triangles checked in {:?}",
            surface.triangles().len(),
            start.elapsed()
        );
        let start = Instant::now();
        let (mended, _) = mend(surface);
        eprintln!("{name}: mended in {:?}", start.elapsed());
        let start = Instant::now();
        let _ = close_holes(&mended, 8);
        eprintln!("{name}: closed in {:?}", start.elapsed());
        report
    }

    fn surface(vertices: impl IntoIterator<Item = [f64; 3]>, triangles: Vec<[u32; 3]>) -> SurfaceMesh {
        SurfaceMesh::new(vertices.into_iter().map(Point::from).collect(), triangles).unwrap()
    }

    /// So many tetrahedra, the k-th at `place(k)`: a corner, and the three next to it along the axes at a distance.
    fn tetrahedra(count: u32, place: impl Fn(u32) -> ([f64; 3], f64)) -> SurfaceMesh {
        let corners = |k: u32| {
            let ([x, y, z], size) = place(k);
            [[x, y, z], [x + size, y, z], [x, y + size, z], [x, y, z + size]]
        };
        let faces = |k: u32| [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]].map(|t| t.map(|v: u32| 4 * k + v));
        surface((0..count).flat_map(corners), (0..count).flat_map(faces).collect())
    }

    #[test]
    fn a_million_loose_triangles() {
        let count = 1_000_000;
        let corner = |k: u32| {
            [
                f64::from(k % 1000),
                f64::from(k / 1000 % 1000),
                f64::from(k / 1_000_000),
            ]
        };
        let corners = (0..count).flat_map(|k| {
            let [x, y, z] = corner(k);
            [[x, y, z], [x + 0.5, y, z], [x, y + 0.5, z]]
        });
        let surface = surface(corners, (0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect());
        examined("loose triangles", &surface);
    }

    #[test]
    fn many_tiny_solids() {
        let place = |k: u32| {
            (
                [f64::from(k % 100), f64::from(k / 100 % 100), f64::from(k / 10_000)],
                0.5,
            )
        };
        examined("solids apart", &tetrahedra(1_000_000, place));
    }

    #[test]
    fn solids_all_in_one_place() {
        examined("solids in one place", &tetrahedra(100_000, |_| ([0.0; 3], 1.0)));
    }

    #[test]
    fn needles_side_by_side() {
        // Each goes along the diagonal of nearly the same box.
        let count = 100_000u32;
        let corners = (0..count).flat_map(|k| {
            let x = f64::from(k) * 1e-6;
            [
                [x, 0.0, 0.0],
                [x + 5e-7, 0.0, 0.0],
                [x, 1e-7, 1e-7],
                [x + 1.0, 1.0, 1.0],
            ]
        });
        let faces = |k: u32| [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]].map(|t| t.map(|v: u32| 4 * k + v));
        examined("needles", &surface(corners, (0..count).flat_map(faces).collect()));
    }

    #[test]
    fn shells_within_shells() {
        let mut nested = shapes::sphere(1.0, 3);
        for k in 1..200 {
            let inner = shapes::sphere(1.0 - f64::from(k) * 0.004, 3);
            nested = shapes::joined(&nested, &inner);
        }
        let report = examined("200 spheres", &nested);
        assert_eq!(report.components.iter().filter_map(|c| c.depth).max(), Some(199));
    }

    #[test]
    fn tetrahedra_within_tetrahedra() {
        let count = 100_000;
        let place = |k: u32| ([f64::from(k) * 1e-6; 3], 1.0 - 4.0 * f64::from(k) * 1e-6);
        examined("nested tetrahedra", &tetrahedra(count, place));
    }

    #[test]
    fn a_book_of_many_pages() {
        let pages = 1_000_000u32;
        let vertex = |k: u32| [f64::from(k).cos(), f64::from(k).sin(), 0.5];
        let vertices = [[0.0; 3], [0.0, 0.0, 1.0]].into_iter().chain((0..pages).map(vertex));
        examined("book", &surface(vertices, (0..pages).map(|k| [0, 1, k + 2]).collect()));
    }

    #[test]
    fn a_long_strip() {
        let count = 1_000_000u32;
        let vertices = (0..count).map(|k| [f64::from(k / 2), f64::from(k % 2), 0.0]);
        let triangle = |k: u32| {
            if k % 2 == 0 {
                [k, k + 1, k + 2]
            } else {
                [k + 1, k, k + 2]
            }
        };
        examined("strip", &surface(vertices, (0..count - 2).map(triangle).collect()));
    }

    #[test]
    fn a_fan_around_one_vertex() {
        let count = 1_000_000u32;
        let vertex = |k: u32| [f64::from(k).cos(), f64::from(k).sin(), 0.0];
        let vertices = [[0.0; 3]].into_iter().chain((0..count).map(vertex));
        examined("fan", &surface(vertices, (1..count).map(|k| [0, k, k + 1]).collect()));
    }
}
