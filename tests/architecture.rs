//! The graph of ARCHITECTURE.md is that of the code: which module imports which, read from the sources.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

type Graph = BTreeMap<String, BTreeSet<String>>;

#[test]
fn the_graph_in_architecture_md_is_that_of_the_code() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let graph = imports(&root.join("src"));
    assert!(graph["fit"].contains("solver"), "imports are not found: {graph:?}");
    let order = layers(&graph);
    let drawn = drawing(&graph, &order);
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    assert!(
        text.contains(&drawn),
        "ARCHITECTURE.md does not show the imports as they are; replace its graph by\n\n{drawn}"
    );
}

/// Without the feature `native`, `.ci/run` tests the modules that it changes. One that starts to depend on the feature
/// must be added there.
#[test]
fn the_feature_native_changes_the_modules_that_are_tested_without_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let sources = root.join("src");
    let mentions = |module: &&String| {
        let texts = files_of(&sources, module);
        let mut texts = texts
            .iter()
            .map(|file| without_tests(&fs::read_to_string(file).unwrap()));
        texts.any(|code| code.contains("feature = \"native\""))
    };
    let graph = imports(&sources);
    let found: Vec<&String> = graph.keys().filter(mentions).collect();
    // `error_kind` is one table in both builds, with the errors of CGAL and TetGen where there are any.
    assert_eq!(found, ["compare", "error_kind", "fit", "model_polycube"]);
}

/// For each module of the library, those that it imports outside of tests.
fn imports(sources: &Path) -> Graph {
    let modules: BTreeSet<String> = fs::read_dir(sources)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| !path.ends_with("lib.rs") && (path.is_file() || path.join("mod.rs").is_file()))
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    let mut graph: Graph = modules.iter().map(|module| (module.clone(), BTreeSet::new())).collect();
    for module in &modules {
        for file in files_of(sources, module) {
            let code = without_tests(&fs::read_to_string(&file).unwrap());
            let used = names_after_crate(&code);
            let others = used.into_iter().filter(|name| modules.contains(name) && name != module);
            graph.get_mut(module).unwrap().extend(others);
        }
    }
    graph
}

/// The files of a module, without those that are declared for tests alone.
fn files_of(folder: &Path, module: &str) -> Vec<PathBuf> {
    let (single, inside) = (folder.join(format!("{module}.rs")), folder.join(module));
    let file = if single.exists() { single } else { inside.join("mod.rs") };
    let code = without_tests(&fs::read_to_string(&file).unwrap());
    let submodules = code.lines().filter_map(|line| {
        let declared = line.trim().strip_suffix(';')?;
        let (_, name) = declared.split_once("mod ")?;
        (declared.starts_with("mod ") || declared.starts_with("pub")).then_some(name)
    });
    let mut files: Vec<PathBuf> = submodules.flat_map(|name| files_of(&inside, name)).collect();
    files.push(file);
    files
}

/// The code without comments and without items that are for tests. Items end at a line that is indented as they are.
fn without_tests(code: &str) -> String {
    let mut kept = String::new();
    let mut lines = code.lines();
    while let Some(line) = lines.next() {
        let trimmed = line.trim_start();
        if trimmed.starts_with("//") {
            continue;
        }
        let is_for_tests = trimmed.starts_with("#[cfg(") && trimmed.contains("test") && !trimmed.contains("not(test");
        if !is_for_tests {
            kept += line;
            kept.push('\n');
            continue;
        }
        let end = format!("{}}}", &line[..line.len() - trimmed.len()]);
        let mut within = false;
        for line in lines.by_ref() {
            let attribute = line.trim_start().starts_with("#[");
            within |= line.ends_with('{');
            if (within && line == end) || (!within && !attribute && (line.ends_with(';') || line.ends_with(','))) {
                break;
            }
        }
    }
    kept
}

/// What follows `crate::`, also in braces.
fn names_after_crate(code: &str) -> BTreeSet<String> {
    let is_name = |c: char| c.is_ascii_lowercase() || c == '_';
    let mut names = BTreeSet::new();
    for (at, found) in code.match_indices("crate::") {
        let rest = &code[at + found.len()..];
        let Some(group) = rest.strip_prefix('{') else {
            names.insert(rest.chars().take_while(|&c| is_name(c)).collect());
            continue;
        };
        // The names at the outermost level of the braces.
        let (mut depth, mut name, mut starts) = (1, String::new(), true);
        for c in group.chars() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' => starts = true,
                _ if depth == 1 && starts && is_name(c) => name.push(c),
                c if c.is_whitespace() => continue,
                _ => starts = false,
            }
            if depth == 0 || !starts || c == ',' {
                names.insert(std::mem::take(&mut name));
            }
            if depth == 0 {
                break;
            }
        }
    }
    names.remove("");
    names
}

/// Modules in layers: each imports from earlier layers only.
fn layers(graph: &Graph) -> Vec<Vec<&str>> {
    let mut layers: Vec<Vec<&str>> = Vec::new();
    let mut placed = BTreeSet::new();
    while placed.len() < graph.len() {
        let ready = graph.iter().filter(|(module, imported)| {
            !placed.contains(module.as_str()) && imported.iter().all(|other| placed.contains(other.as_str()))
        });
        let layer: Vec<&str> = ready.map(|(module, _)| module.as_str()).collect();
        let stuck = || {
            graph
                .keys()
                .filter(|module| !placed.contains(module.as_str()))
                .collect::<Vec<_>>()
        };
        assert!(!layer.is_empty(), "modules import each other in a cycle: {:?}", stuck());
        placed.extend(layer.iter().copied());
        layers.push(layer);
    }
    layers
}

/// The graph for Mermaid, without arrows that follow from others.
fn drawing(graph: &Graph, layers: &[Vec<&str>]) -> String {
    let mut reachable: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    let mut text = String::from("```mermaid\ngraph TD\n");
    let mut arrows = Vec::new();
    for module in layers.iter().flatten() {
        let direct: BTreeSet<&str> = graph[*module].iter().map(String::as_str).collect();
        let further: BTreeSet<&str> = direct.iter().flat_map(|other| &reachable[other]).copied().collect();
        let needed: Vec<&str> = direct.difference(&further).copied().collect();
        if !needed.is_empty() {
            arrows.push(format!("  {module} --> {}\n", needed.join(" & ")));
        }
        reachable.insert(module, &direct | &further);
    }
    text.extend(arrows.into_iter().rev());
    text += "```\n";
    text
}
