//! The crates of the library are layers: no module uses one that uses it, in any way. The compiler does not check
//! that; here it is read from the source, as is the number of types that a user meets.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::{fs, io};

/// The top-level modules of a crate, each with those that it uses.
type Graph = BTreeMap<String, BTreeSet<String>>;

/// Stands for the file that declares the modules.
const ROOT: &str = "the root";

/// Adds what a file, or all files of a folder, of `module` use, without tests and comments. All modules stand below
/// `root`.
fn read(graph: &mut Graph, module: &str, root: &str, path: &Path) -> io::Result<()> {
    if path.is_dir() {
        for entry in fs::read_dir(path)? {
            read(graph, module, root, &entry?.path())?;
        }
    } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with("tests.rs") {
        let source = fs::read_to_string(path)?;
        // Modules of a folder name each other by way of it.
        let is_top = path.file_stem().is_some_and(|stem| stem == module);
        let source = if is_top { source.replace("super::", "crate::") } else { source };
        add(graph, module, &source.replace(root, "crate::"));
    }
    Ok(())
}

fn add(graph: &mut Graph, module: &str, source: &str) {
    let uses = graph.entry(module.to_owned()).or_default();
    // By convention the tests of a file stand at its end.
    let code = source.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let lines = code.lines().map(|line| line.split("//").next().unwrap_or_default());
    let code: String = lines.collect::<Vec<_>>().join("\n");
    for after in code.split("crate::").skip(1) {
        // Of a group each path; those within a path's own braces are none.
        let (mut depth, mut paths) = (0, vec![String::new()]);
        for c in after.chars().take_while(|c| *c != ';') {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 1 => paths.push(String::new()),
                _ if depth < 2 => paths.last_mut().expect("one").push(c),
                _ => {}
            }
            if depth < 0
                || depth == 0 && !after.starts_with('{') && !c.is_alphanumeric() && c != '_'
            {
                break;
            }
        }
        let first = |path: &String| {
            let end = |c: char| !c.is_alphanumeric() && c != '_';
            path.trim_start().split(end).next().unwrap_or_default().to_owned()
        };
        // What the root exports is of all its modules.
        let used = |name: String| {
            if name.starts_with(char::is_uppercase) { ROOT.to_owned() } else { name }
        };
        let used =
            paths.iter().map(first).filter(|name| !name.is_empty() && name != module).map(used);
        uses.extend(used);
    }
}

/// The modules in an order in which each uses only those before it; else those of a circle, and their users.
fn layers(graph: &Graph) -> Result<Vec<&str>, Vec<&str>> {
    let mut order: Vec<&str> = Vec::new();
    loop {
        let left = || graph.iter().filter(|(name, _)| !order.contains(&name.as_str()));
        let is_placed = |name: &String| order.contains(&name.as_str()) || !graph.contains_key(name);
        let next = left().filter(|(_, uses)| uses.iter().all(is_placed));
        let next: Vec<&str> = next.map(|(name, _)| name.as_str()).collect();
        if next.is_empty() {
            let stuck: Vec<&str> = left().map(|(name, _)| name.as_str()).collect();
            return if stuck.is_empty() { Ok(order) } else { Err(stuck) };
        }
        order.extend(next);
    }
}

#[test]
fn no_modules_of_the_library_use_each_other_in_a_circle() {
    for (src, root, least) in [
        ("client-lib/core/src", "crate::", 12),
        ("client-lib/wire/src", "crate::", 6),
        ("client-lib/transport/src", "crate::", 10),
        ("client-lib/src/session", "crate::session::", 15),
        ("client-lib/src/session/scene", "crate::session::scene::", 8),
    ] {
        let mut graph = Graph::new();
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(src);
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let module = path.file_stem().unwrap().to_str().unwrap();
            if !["lib", "main", "mod"].contains(&module) {
                read(&mut graph, module, root, &path).unwrap();
            }
        }
        let modules = graph.len();
        assert!(modules >= least, "{src} has {modules} modules: read from the wrong place?");
        // That of wire has the numbers of the contract, which all use.
        if src != "client-lib/wire/src" {
            graph.insert(ROOT.to_owned(), graph.keys().cloned().collect());
        }
        layers(&graph).unwrap_or_else(|stuck| panic!("{src}: a circle in {stuck:?}"));
    }
}

#[test]
fn a_circle_is_found() {
    let mut graph = Graph::new();
    let tests = "#[cfg(test)]\nmod tests { use crate::high::Other; }";
    add(&mut graph, "low", "use std::fmt; // crate::high");
    add(&mut graph, "middle", &format!("use crate::low::Thing;\n{tests}"));
    add(&mut graph, "high", "use crate::{low::{A, B}, middle};\nfn f() { crate::low::g(); }");
    assert_eq!(layers(&graph), Ok(vec!["low", "middle", "high"]));
    let mut by_root = graph.clone();
    by_root.insert(ROOT.to_owned(), graph.keys().cloned().collect());
    assert!(layers(&by_root).is_ok());
    add(&mut by_root, "middle", "use crate::{Exported, low};");
    assert_eq!(layers(&by_root), Err(vec!["high", "middle", ROOT]));
    add(&mut graph, "low", "fn f() { crate::high::g(); }");
    assert_eq!(layers(&graph), Err(vec!["high", "low", "middle"]));
}

#[test]
fn the_library_exports_few_types() {
    let lib = Path::new(env!("CARGO_MANIFEST_DIR")).join("../client-lib/src/lib.rs");
    let source = fs::read_to_string(lib).unwrap();
    let lists = source.split("pub use ").skip(1).filter_map(|after| after.split(';').next());
    let paths = lists.flat_map(|list| list.split([',', '{', '}'])).map(str::trim);
    let names = paths.filter_map(|path| path.rsplit([':', ' ']).next());
    let types: BTreeSet<&str> = names.filter(|name| name.starts_with(char::is_uppercase)).collect();
    assert!(types.contains("DaemonStatus") && types.contains("Scene"), "{types:?}");
    // Six of them are those of casts, one is the error of files, one names snapshots, and one is what an observer receives.
    assert!(types.len() <= 54, "{} types: {types:?}", types.len());
}
