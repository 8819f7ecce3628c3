//! The header declares what this crate defines.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The words and signs of a text in C, without its comments.
fn tokens(text: &str) -> Vec<String> {
    let is_of_word = |c: char| c.is_alphanumeric() || c == '_';
    let apart = |c| if is_of_word(c) { c.to_string() } else { format!(" {c} ") };
    text.chars().map(apart).collect::<String>().split_whitespace().map(str::to_owned).collect()
}

/// All declarations of a header but `#include` and the like, regardless of their order, layout and comments.
fn declarations(header: &str) -> BTreeSet<String> {
    let code = header.split_once("*/").map_or(header, |(_, behind_the_head)| behind_the_head);
    let lines = code.lines().map(|line| line.split("//").next().unwrap_or_default());
    let (directives, code): (Vec<&str>, Vec<&str>) = lines.partition(|line| line.starts_with('#'));
    let constants = directives.iter().map(|line| tokens(line));
    let constants = constants.filter(|line| line[1] == "define" && line.len() > 3);
    let code = code.join("\n").replace("extern \"C\" {", "");

    let (mut all, mut now, mut depth) = (Vec::new(), Vec::new(), 0);
    for token in tokens(&code) {
        depth += i32::from(token == "{") - i32::from(token == "}");
        if token == ";" && depth == 0 {
            all.push(std::mem::take(&mut now));
        } else {
            now.push(token);
        }
    }
    // The crate's own names of pointers are those of no program.
    let pointers = all.extract_if(.., |typedef: &mut Vec<String>| {
        typedef.last().is_some_and(|name| name.starts_with("In_") || name.starts_with("Out_"))
    });
    let pointers: BTreeMap<_, _> =
        pointers.filter_map(|mut of| Some((of.pop()?, of[1..].to_vec()))).collect();
    let expand = |token: String| pointers.get(&token).cloned().unwrap_or_else(|| vec![token]);
    let all = all.into_iter().map(|of| of.into_iter().flat_map(expand).collect());
    all.chain(constants).map(|of: Vec<String>| of.join(" ")).collect()
}

#[test]
fn the_header_declares_what_this_crate_defines() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(root.join("cbindgen.toml")).expect("cbindgen.toml");
    let made = cbindgen::Builder::new().with_crate(root).with_config(config).generate();
    let mut bytes = Vec::new();
    made.expect("a header").write(&mut bytes);
    let defined = declarations(&String::from_utf8(bytes).expect("a text"));
    let header = std::fs::read_to_string(root.join("include/pairmask.h")).expect("the header");
    let declared = declarations(&header);
    for name in ["pm_session_connect", "PM_ERR_HANDLE", "pm_scene_lease", "PM_BACKEND_DAEMON"] {
        assert!(declared.iter().any(|of| of.contains(name)), "{name}");
    }
    let missing: Vec<_> = defined.difference(&declared).collect();
    let extra: Vec<_> = declared.difference(&defined).collect();
    assert!(missing.is_empty() && extra.is_empty(), "missing: {missing:#?}\nextra: {extra:#?}");
}
