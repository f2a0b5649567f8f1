//! `docs/json.md` and the program agree: every field that a command writes is documented, and every documented field is
//! written by one of the runs below, but for those in [`NOT_MADE_HERE`].

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::{Point, Vector};

use crate::common::bent;
use crate::workplace::{Workplace, json, write_impossible_stairs, write_turned_boxes};

const PAGE: &str = include_str!("../../docs/json.md");

/// Fields of reports that take defects, other builds or long runs.
const NOT_MADE_HERE: [(&str, &str); 20] = [
    // In builds without CGAL.
    ("boundary check", "self_intersections.reason"),
    ("checked model", "self_intersections.reason"),
    // Of maps that are wrong: tested in `boundary_map::pair::isometry`.
    ("boundary pair", "nearer_isometry.isometry_defect"),
    ("boundary pair", "nearer_isometry.distance"),
    // Tested where the defects are: `names_that_are_not_utf8…`, `src/check`, `tests/spherical.rs`, `cli/tests/transfer.rs`,
    // `cli/tests/texture.rs`, `cli/tests/sequence.rs`, `cli/tests/compare.rs`.
    ("every document", "lossy_names"),
    ("finding", "vertices[]"),
    ("cells", "findings[].vertices[]"),
    ("spherical embedding", "first_flipped"),
    ("label", "label"),
    ("label", "before"),
    ("label", "after"),
    ("transfer", "fields[].labels[]"),
    ("texture", "image"),
    ("texture", "tolerance"),
    ("texture", "tolerance_met"),
    ("compared map", "remarks[]"),
    ("compare", "sequence[].error"),
    // Takes a model without a polycube, and minutes.
    ("hexmesh", "problem"),
    // `tests/bijective.rs`: a file of such a map is written by no command.
    ("certify of a bijective map", "domain_problems[]"),
    ("certify of a bijective map", "target_problems[]"),
];

/// A section of the page: its fields, and parts all of whose fields it has.
#[derive(Default)]
struct Section {
    /// Paths, and for a part its name.
    rows: Vec<(String, Option<String>)>,
    all_of: Vec<String>,
}

/// The target of a link to a part in a line.
fn part(line: &str) -> Option<String> {
    let (_, rest) = line.split_once("](#")?;
    Some(rest.split(')').next()?.replace('-', " "))
}

fn sections() -> BTreeMap<String, Section> {
    let mut sections: BTreeMap<String, Section> = BTreeMap::new();
    let mut name = String::new();
    for line in PAGE.lines() {
        if let Some(heading) = line.strip_prefix("## ").or(line.strip_prefix("### ")) {
            name = heading.to_lowercase();
            assert!(
                sections.insert(name.clone(), Section::default()).is_none(),
                "{name} twice"
            );
        } else if line.starts_with("All fields of ") {
            sections.get_mut(&name).unwrap().all_of.extend(part(line));
        } else if let Some(row) = line.strip_prefix("| `") {
            let path = row.split('`').next().unwrap().to_owned();
            let section = sections.get_mut(&name).unwrap();
            section.rows.push((path, part(line.split(" | ").nth(1).unwrap())));
        }
    }
    sections
}

/// The page, and which of its rows were seen.
struct Page {
    sections: BTreeMap<String, Section>,
    seen: BTreeSet<(String, String)>,
}

impl Page {
    /// Whether a section documents a value without fields at a path; marks its row as seen.
    fn documents(&mut self, section: &str, path: &str) -> bool {
        let found = self
            .sections
            .get(section)
            .unwrap_or_else(|| panic!("no section `{section}`"));
        let rows = found.rows.clone();
        for part in found.all_of.clone() {
            if self.documents(&part, path) {
                return true;
            }
        }
        for (row, part) in rows {
            let is_here = match &part {
                Some(part) => {
                    let rest = path.strip_prefix(&row).and_then(|rest| rest.strip_prefix('.'));
                    rest.is_some_and(|rest| self.documents(part, rest))
                }
                // `*` stands for any name.
                None => row == path || row.strip_suffix('*').is_some_and(|start| path.starts_with(start)),
            };
            if is_here {
                self.seen.insert((section.to_owned(), row));
                return true;
            }
        }
        false
    }

    /// Whether a section documents something at a path where there was `null` or an empty list.
    fn documents_absence(&self, section: &str, path: &str) -> bool {
        let found = &self.sections[section];
        let starts = [".", "["].map(|next| format!("{path}{next}"));
        let is_here = |(row, part): &(String, Option<String>)| {
            let rest = path.strip_prefix(row.as_str()).and_then(|rest| rest.strip_prefix('.'));
            let within = part
                .as_ref()
                .zip(rest)
                .is_some_and(|(part, rest)| self.documents_absence(part, rest));
            row == path || within || starts.iter().any(|start| row.starts_with(start.as_str()))
        };
        found.rows.iter().any(is_here) || found.all_of.iter().any(|part| self.documents_absence(part, path))
    }
}

/// Adds the paths of all values without fields; of `null` and empty lists, which may stand for values with fields,
/// separately.
fn written(value: &Value, path: &str, found: &mut BTreeSet<String>, empty: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                let dot = if path.is_empty() { "" } else { "." };
                written(value, &format!("{path}{dot}{name}"), found, empty);
            }
        }
        Value::Array(values) if values.is_empty() => drop(empty.insert(format!("{path}[]"))),
        Value::Array(values) => values
            .iter()
            .for_each(|value| written(value, &format!("{path}[]"), found, empty)),
        Value::Null => drop(empty.insert(path.to_owned())),
        _ => drop(found.insert(path.to_owned())),
    }
}

/// A folder with models, and a map from a cube to a ball.
fn place() -> Workplace {
    let place = Workplace::new();
    let cube = shapes::cube(2.0, 6);
    place.surface("cube.ply", &cube);
    place.surface("round.ply", &shapes::projected_to_sphere(&cube, 1.0));
    place.surface(
        "needle.ply",
        &shapes::deformed(&cube, |p| Point::new(0.02 * p.x, 0.02 * p.y, p.z)),
    );
    // Its top turns once about its axis: too far from node to node of a coarse grid.
    let fine = shapes::cube(1.0, 16);
    place.surface("fine.ply", &fine);
    let turned = |p: &Point| {
        let (sin, cos) = (std::f64::consts::TAU * p.z).sin_cos();
        let q = Vector::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z).normalize();
        Point::new(q.x, 1.3 * q.y, 1.6 * q.z)
    };
    place.surface("turned.ply", &shapes::deformed(&fine, turned));
    let ball = shapes::sphere(1.0, 2);
    place.surface("ball.ply", &ball);
    place.surface("hollow.ply", &shapes::spherical_shell(1.0, 0.4, 2));
    // A cube has other maps to itself, and so has a solid of which it is a part.
    let aside = shapes::deformed(&shapes::cube(1.0, 6), |p| Point::new(p.x + 5.0, p.y, p.z));
    place.surface("mixed.ply", &shapes::joined(&shapes::sphere(1.0, 2), &aside));
    let ring = shapes::torus(1.0, 0.4, 16, 8);
    place.surface("ring.ply", &ring);
    let rings = shapes::double_torus(1);
    place.surface("rings.ply", &rings);
    place.surface(
        "rings2.ply",
        &shapes::deformed(&rings, |p| Point::new(1.1 * p.x, p.y + 0.02 * p.x * p.x, p.z)),
    );
    place.surface(
        "oval.ply",
        &shapes::deformed(&ring, |p| Point::new(1.2 * p.x + 0.1 * p.y * p.y, p.y, p.z)),
    );
    place.surface("bent.ply", &shapes::deformed(&ball, bent(0.2)));
    place.surface(
        "folded.ply",
        &shapes::deformed(&ball, |p| Point::new(p.x.abs(), p.y, p.z)),
    );
    let mut open = ball.triangles().to_vec();
    open.pop();
    let open = SurfaceMesh::new(ball.vertices().to_vec(), open).unwrap();
    place.surface("open.ply", &open);
    place.surface("opened.ply", &shapes::deformed(&open, bent(0.1)));
    let joined = |other: &SurfaceMesh| {
        let shift = ball.vertices().len() as u32;
        let moved = other.triangles().iter().map(|t| t.map(|v| v + shift));
        let triangles = ball.triangles().iter().copied().chain(moved).collect();
        SurfaceMesh::new([ball.vertices(), other.vertices()].concat(), triangles).unwrap()
    };
    place.surface(
        "both.ply",
        &joined(&shapes::deformed(&ball, |p| Point::new(p.x + 1.0, p.y, p.z))),
    );
    place.surface("shell.ply", &joined(&shapes::deformed(&ball, |p| p * 0.5).reversed()));
    std::fs::write(place.path("field.csv"), "x,y,z,s\n0,0,0,1\n0.1,0,0,2\n").unwrap();
    std::fs::write(place.path("at.csv"), "x,y,z\n0,0,0\n0.3,0.1,0\n").unwrap();
    for k in 0..12 {
        let a = 0.1 * (1.0 - (std::f64::consts::TAU * k as f64 / 4.0).cos());
        place.surface(&format!("f{k:02}.ply"), &shapes::deformed(&ball, bent(a)));
    }
    let uv: String = ball
        .vertices()
        .iter()
        .map(|p| format!("v {} {} {}\nvt {} {}\n", p.x, p.y, p.z, p.x, p.y))
        .collect();
    let faces = ball.triangles().iter().map(|t| {
        let [a, b, c] = t.map(|v| v + 1);
        format!("f {a}/{a} {b}/{b} {c}/{c}\n")
    });
    std::fs::write(place.path("uv.obj"), uv + &faces.collect::<String>()).unwrap();
    let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.]].map(Point::from);
    let tets = [[0, 1, 2, 3], [4, 1, 2, 3]];
    solidmap::io::write_cells(place.path("inverted.vtu"), &corners, solidmap::io::Cells::Tets(&tets)).unwrap();
    place.ends_with(0, "fit cube.ply --image round.ply --tolerance 0.01 -o cube.map");
    place.ends_with(0, "fit ball.ply --image bent.ply --tolerance 0.01 -o ball.map");
    place.run("fit ball.ply --image folded.ply -o folded.map --tolerance 0.1");
    place.ends_with(0, "tet ball.ply -o ball.vtu");
    write_turned_boxes(&place);
    write_impossible_stairs(&place);
    place
}

#[test]
fn every_field_of_a_report_is_documented_and_written() {
    let place = place();
    let runs: &[(&str, &str)] = &[
        ("check", "check ball.ply open.ply none.ply cube.ply inverted.vtu"),
        (
            "boundary pair",
            "boundary pair ball.ply bent.ply -o p.ply --boundary p.safetensors --png p.png --vtu p.vtu --html p.html",
        ),
        (
            "boundary pair",
            "boundary pair ball.ply bent.ply -o q.ply --via conformal",
        ),
        (
            "boundary pair",
            "boundary pair cube.ply needle.ply -o r.ply --alternatives 2 --max-stretched 1",
        ),
        (
            "boundary pair",
            "boundary pair ring.ply oval.ply -o t.ply --boundary t.safetensors",
        ),
        ("boundary pair", "boundary pair rings.ply rings2.ply -o h.ply"),
        ("boundary pair", "boundary pair hollow.ply hollow.ply -o hh.ply"),
        (
            "boundary pair",
            "boundary pair mixed.ply mixed.ply -o mm.ply --alternatives 2 --max-stretched 1",
        ),
        ("boundary check", "boundary check t.safetensors"),
        (
            "boundary improve",
            "boundary improve t.safetensors -o i.ply --boundary i.safetensors --png i.png --vtu i.vtu --html i.html --rounds 2 \
             --tolerance 1e-9",
        ),
        ("boundary check", "boundary check ball.ply bent.ply"),
        ("boundary check", "boundary check ball.ply folded.ply --target ball.ply"),
        ("boundary check", "boundary check p.safetensors"),
        ("boundary check", "boundary check cube.ply round.ply"),
        (
            "boundary sphere",
            "boundary sphere cube.ply -o s.ply --boundary s.safetensors --png s.png --vtu s.vtu --html s.html",
        ),
        (
            "boundary torus",
            "boundary torus ring.ply -o rt.ply --boundary rt.safetensors --png rt.png --vtu rt.vtu --html rt.html",
        ),
        (
            "boundary unfold",
            "boundary unfold rings.ply -o u.ply --png u.png --html u.html",
        ),
        ("fit", "fit ball.ply --image bent.ply -o x.map --tolerance 0.01"),
        (
            "fit",
            "fit ball.ply --image bent.ply -o x.map --method dense --tolerance 0.1",
        ),
        ("fit", "fit ball.ply --image bent.ply -o x.map --paper --tolerance 0.1"),
        (
            "fit",
            "fit ball.ply --image bent.ply -o x.map --radius 2 --method svd --tolerance 0.1",
        ),
        ("fit", "fit ball.ply --target sphere -o x.map --tolerance 0.01"),
        (
            "fit",
            "fit ball.ply --image folded.ply -o free.map --free-sources --max-sources 40 --tolerance 0.1",
        ),
        ("fit", "fit --boundary p.safetensors -o x.map --tolerance 0.01"),
        (
            "fit",
            "fit ball.ply --image bent.ply -o both.map --tolerance 0.01 --bijective",
        ),
        (
            "polycube",
            "polycube ball.vtu -o pc.obj --image pm.obj --tets pt.mesh --model-tets pn.mesh --lattice 0.3 \
             --write-labels pl.txt --write-model-labels pm.txt --boundary pb.safetensors --png pc.png --html pc.html",
        ),
        (
            "polycube",
            "polycube ball.vtu -o pv.obj --image pw.obj --polycube voxels",
        ),
        (
            "polycube",
            "polycube ball.vtu -o ps.obj --image pr.obj --max-vertices 100",
        ),
        (
            "polycube",
            "polycube turned.mesh -o pt.obj --image pu.obj --orient principal --features 40",
        ),
        (
            "polycube",
            "polycube block.mesh -o px.obj --image py.obj --labels stairs.txt --best-attempt pb.vtu",
        ),
        (
            "hexmesh",
            "hexmesh ball.vtu -o hm.vtu --cells 6 --keep hk --png hm.png --html hm.html",
        ),
        ("hexmesh", "hexmesh ball.vtu -o hv.vtu --cells 6 --polycube voxels"),
        ("hexmesh", "hexmesh ball.vtu -o hs.vtu --cells 6 --max-vertices 100"),
        ("bijective", "bijective ball.map --mesh ball.vtu -o other.map"),
        ("bijective", "bijective folded.map --mesh ball.vtu"),
        ("eval", "eval both.map at.csv -o e.csv"),
        ("eval --inverse", "eval both.map at.csv --inverse -o i.csv"),
        ("energy", "energy both.map --html e.html --samples 8"),
        ("view", "view both.map -o v.html --samples 8"),
        ("view", "view inverted.vtu -o w.html"),
        ("view", "view p.safetensors -o b.html"),
        ("certify of a bijective map", "certify both.map"),
        ("transfer", "transfer both.map field.csv --at at.csv -o t.csv"),
        ("eval", "eval cube.map at.csv -o e.csv"),
        ("eval", "eval cube.map inverted.vtu -o e.vtu"),
        ("eval --inverse", "eval cube.map at.csv --inverse -o i.csv"),
        ("energy", "energy cube.map --resolution 8"),
        ("certify", "certify ball.map --finest 32"),
        ("certify", "certify folded.map --finest 16 --html c.html --samples 8"),
        (
            "transfer",
            "transfer cube.map field.csv -o t.csv --png t.png --html t.html --samples 8",
        ),
        ("transfer", "transfer cube.map field.csv --at at.csv -o t.csv"),
        (
            "remesh",
            "remesh folded.map --mesh ball.vtu -o r.vtu --png r.png --html r.html",
        ),
        ("remesh", "remesh cube.map --cells 64 -o r.vtu --domain-mesh rd.vtu"),
        ("fit", "fit fine.ply --image turned.ply -o turned.map --no-refine"),
        ("remesh", "remesh turned.map --cells 4 -o r.vtu"),
        (
            "texture",
            "texture uv.obj --checker=4 -o v.vti --png v.png --html v.html --map v.safetensors --at at.csv --colours c.csv --resolution 16",
        ),
        (
            "texture",
            "texture uv.obj --checker=4 --through both.map -o w.vti --at at.csv --colours d.csv --resolution 8",
        ),
        (
            "sequence",
            "sequence ball.ply f00.ply f01.ply f02.ply f03.ply f04.ply f05.ply f06.ply f07.ply f08.ply f09.ply \
                      f10.ply f11.ply cube.ply -o seq --resolution 8 --no-vtu",
        ),
        ("compare", "compare ball.ply --image bent.ply --resolution 8"),
        (
            "compare",
            "compare --boundary p.safetensors --resolution 8 --methods mfs,mean-value --no-reference",
        ),
        (
            "compare",
            "compare ball.ply --image bent.ply --resolution 8 --methods mfs,fem --equal-accuracy --mesh-study --frames \
                     f00.ply f01.ply",
        ),
        ("compare", "compare ball.ply --image cube.ply --resolution 8"),
        ("compare --metrics", "compare ball.vtu --image ball.vtu --metrics m.csv"),
        (
            "compare",
            "compare ball.ply --image bent.ply --resolution 8 --methods fem --no-reference --frames cube.ply f01.ply",
        ),
        (
            "sequence",
            "sequence open.ply opened.ply -o seq2 --close-holes --resolution 8 --material ball.vtu --html seq2.html",
        ),
        (
            "sequence",
            "sequence ball.ply bent.ply -o seq4 --map bijective --resolution 8 --no-vtu",
        ),
        ("sequence", "sequence both.ply both.ply -o seq3 --resolution 8 --no-vtu"),
        ("view", "view seq2 -o s.html"),
        (
            "study",
            "study placement ball.ply bent.ply --placements sphere,offset,adaptive --radius 0.4,1 --offset 0.1 --alpha 1 \
             --resolution 8 -o study.csv --png study.png --html study.html",
        ),
        (
            "study",
            "study ratios --boundary p.safetensors --alpha 1 --s-ratio 0.5 --c-ratio 1 --resolution 8",
        ),
        (
            "study boundary",
            "study boundary bent.ply f03.ply --domain ball.ply --tolerance 0.01 --resolution 8 -o maps.csv --png maps.png \
             --html maps.html",
        ),
        (
            "study boundary",
            "study boundary bent.ply --domain ball.ply --memory 1MB",
        ),
        ("check", "check shell.ply"),
        ("tet", "tet ball.ply -o ball.vtu"),
        ("offset", "offset ball.ply --distance 0.2 -o offset.ply"),
        ("demo", "demo --out demo"),
    ];
    let mut page = Page {
        sections: sections(),
        seen: BTreeSet::new(),
    };
    let mut wrong = Vec::new();
    for (name, line) in runs {
        let report = json(&place.run(&format!("{line} --json")));
        assert!(report.get("error").is_none(), "{line}: {report}");
        let (mut found, mut empty) = (BTreeSet::new(), BTreeSet::new());
        written(&report, "", &mut found, &mut empty);
        found.retain(|path| !page.documents("every document", path) && !page.documents(name, path));
        empty.retain(|path| !page.documents_absence(name, path));
        let unknown = found.iter().chain(&empty);
        wrong.extend(unknown.map(|path| format!("{name} writes `{path}`, which is not documented")));
    }
    let error = json(&place.run("eval none.map at.csv -o e.csv --json"));
    let (mut found, mut empty) = (BTreeSet::new(), BTreeSet::new());
    written(&error, "", &mut found, &mut empty);
    found.retain(|path| !page.documents("every document", path) && !page.documents("errors", path));
    wrong.extend(
        found
            .iter()
            .map(|path| format!("an error has `{path}`, which is not documented")),
    );
    for (name, section) in &page.sections {
        for (path, _) in &section.rows {
            let seen = page.seen.contains(&(name.clone(), path.clone()));
            if !seen && !NOT_MADE_HERE.contains(&(name, path)) {
                wrong.push(format!("nothing writes `{path}` of {name}"));
            }
        }
    }
    wrong.dedup();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
