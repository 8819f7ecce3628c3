//! The book holds together: its pages are listed, its links and those of all documents lead somewhere, its examples
//! are run, and the error texts that it quotes are those of the sources.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn crate_root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn pages_folder() -> PathBuf {
    crate_root().join("book/src")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The pages by name, without the summary.
fn pages() -> Vec<(String, String)> {
    let mut pages = Vec::new();
    walk_files(&pages_folder(), ".md", &mut |path, page| {
        let name = path.file_name().expect("a file has a name").to_string_lossy().into_owned();
        pages.push((name, page.to_owned()));
    });
    pages.retain(|(name, _)| name != "SUMMARY.md");
    pages.sort();
    assert!(pages.len() > 8, "{} pages: read from the wrong place?", pages.len());
    pages
}

/// A block of code: what stands behind its opening fence, and its text.
struct Fenced<'a> {
    language: &'a str,
    lines: Vec<&'a str>,
}

/// The blocks of code of a page, and the lines outside of them.
fn split_fences(page: &str) -> (Vec<Fenced<'_>>, Vec<&str>) {
    let (mut blocks, mut outside) = (Vec::new(), Vec::new());
    let mut open: Option<Fenced<'_>> = None;
    for line in page.lines() {
        match (line.strip_prefix("```"), open.take()) {
            (Some(language), None) => open = Some(Fenced { language, lines: Vec::new() }),
            (Some(_), Some(block)) => blocks.push(block),
            (None, None) => outside.push(line),
            (None, Some(mut block)) => {
                block.lines.push(line);
                open = Some(block);
            }
        }
    }
    assert!(open.is_none(), "a block of code without an end");
    (blocks, outside)
}

/// The targets of a page's links and pictures, those to the web left out.
fn links(page: &str) -> Vec<String> {
    let text = split_fences(page).1.join("\n");
    let targets = |mark, end| {
        let after = text.split(mark).skip(1);
        after.filter_map(move |after: &str| after.split(end).next()).collect::<Vec<_>>()
    };
    let all = targets("](", ')').into_iter().chain(targets("src=\"", '"'));
    all.filter(|target| !target.contains("://")).map(str::to_owned).collect()
}

/// The anchor of a heading, as mdBook and code hosts make it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn anchors(page: &str) -> BTreeSet<String> {
    let lines = split_fences(page).1.into_iter().filter(|line| line.starts_with('#'));
    lines.map(|line| anchor(line.trim_start_matches('#'))).collect()
}

/// What is wrong with a link of a page in `folder`, if anything is.
fn fault_of_link(folder: &Path, page: &str, link: &str) -> Option<String> {
    let (file, requested) = link.split_once('#').map_or((link, None), |(file, a)| (file, Some(a)));
    let target = folder.join(file);
    if !file.is_empty() && !target.exists() {
        return Some(format!("{link}: no such file"));
    }
    let requested = requested?;
    let there = if file.is_empty() { anchors(page) } else { anchors(&read(&target)) };
    (!there.contains(requested)).then(|| format!("{link}: no such heading, there are {there:?}"))
}

/// Rust's string literal that `text` begins with, with `…` in place of what is filled in.
fn literal(text: &str) -> Option<String> {
    let mut chars = text.strip_prefix('"')?.chars().peekable();
    let mut found = String::new();
    loop {
        match chars.next()? {
            '"' => return Some(found),
            '\\' => match chars.next()? {
                '\n' => while chars.next_if(|c| c.is_whitespace()).is_some() {},
                c => found.push(c),
            },
            '{' if chars.next_if_eq(&'{').is_some() => found.push('{'),
            '{' => {
                while chars.next()? != '}' {}
                found.push('…');
            }
            '}' => found.extend(chars.next_if_eq(&'}')),
            c => found.push(c),
        }
    }
}

/// What stands before a line of the log.
const LOGS: [&str; 3] = ["log::error!(", "log::warn!(", "log::info!("];

/// Texts of errors and of lines of the log in a source file.
fn texts_of(source: &str) -> impl Iterator<Item = String> {
    let errors = source.split("#[error(").skip(1);
    let errors = errors.filter_map(|after| literal(after.trim_start()));
    let lines = LOGS.into_iter().flat_map(|mark| source.split(mark).skip(1)).filter_map(|after| {
        // Arguments may stand before the text: it is the first literal of the statement.
        let statement = after.split(";\n").next()?;
        literal(&after[statement.find('"')?..])
    });
    errors.chain(lines)
}

/// Iterates over the files below a folder that end so, without those of builds and of hidden folders.
fn walk_files(folder: &Path, ending: &str, iterate: &mut impl FnMut(&Path, &str)) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("an entry has a name").to_string_lossy();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            walk_files(&path, ending, iterate);
        } else if name.ends_with(ending) {
            iterate(&path, &read(&path));
        }
    }
}

/// All texts that users of the library and of the daemon may see.
fn source_texts() -> BTreeSet<String> {
    let mut texts = BTreeSet::new();
    for folder in ["src", "core/src", "wire/src", "transport/src", "../daemon/src"] {
        let folder = crate_root().join(folder);
        walk_files(&folder, ".rs", &mut |_, source| {
            texts.extend(texts_of(source));
            // Errors of the command line are texts where they are made: any literal may be one.
            texts.extend(source.match_indices('"').filter_map(|(at, _)| literal(&source[at..])));
        });
    }
    assert!(texts.len() > 150, "{} texts: read from the wrong place?", texts.len());
    texts
}

/// The error texts that the page of troubleshooting quotes.
fn quoted_texts() -> BTreeSet<String> {
    let page = read(&pages_folder().join("troubleshooting.md"));
    let blocks = split_fences(&page).0.into_iter().filter(|block| block.language == "text");
    let texts: BTreeSet<String> = blocks.flat_map(|b| b.lines).map(str::to_owned).collect();
    assert!(texts.len() > 100, "{} texts", texts.len());
    texts
}

#[test]
fn the_summary_lists_every_page_once() {
    let summary = read(&pages_folder().join("SUMMARY.md"));
    let mut listed = links(&summary);
    listed.sort();
    let names: Vec<String> = pages().into_iter().map(|(name, _)| name).collect();
    assert_eq!(listed, names);
}

#[test]
fn links_lead_to_files_and_headings() {
    let mut count = 0;
    let mut faults = Vec::new();
    walk_files(&crate_root().join(".."), ".md", &mut |path, page| {
        for link in links(page) {
            count += 1;
            let fault = fault_of_link(path.parent().expect("a folder"), page, &link);
            faults.extend(fault.map(|fault| format!("{}: {fault}", path.display())));
        }
    });
    assert!(count > 250, "{count} links: read from the wrong place?");
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn a_broken_link_is_seen() {
    let page =
        "# Top\n[a](b.md#c) ![d](e.svg) [w](https://x.y)\n```text\n[f](g.md)\n# No heading\n```\n";
    assert_eq!(links(page), ["b.md#c", "e.svg"]);
    assert_eq!(anchors(page), BTreeSet::from(["top".to_owned()]));
    assert_eq!(anchor(" 3. What `it` is, and isn't"), "3-what-it-is-and-isnt");
    let fault = |link| fault_of_link(&pages_folder(), page, link);
    assert_eq!(fault("#top"), None);
    assert_eq!(fault("SUMMARY.md#summary"), None);
    for broken in ["#bottom", "SUMMARY.md#bottom", "no-such-page.md"] {
        assert!(fault(broken).is_some(), "{broken}");
    }
}

/// Pages with examples in Rust that are not run.
fn not_run(pages: &[(String, String)], run: &str) -> Vec<String> {
    let has_rust = |page: &str| split_fences(page).0.iter().any(|b| b.language.starts_with("rust"));
    let is_run = |name: &str| run.contains(&format!("\"book/src/{name}\""));
    let left_out = pages.iter().filter(|(name, page)| has_rust(page) && !is_run(name));
    left_out.map(|(name, _)| name.clone()).collect()
}

#[test]
fn every_example_in_rust_is_run() {
    let run = read(&crate_root().join("src/book.rs"));
    assert_eq!(not_run(&pages(), &run), [""; 0], "add them to src/book.rs");
    assert_eq!(not_run(&[("new.md".into(), "```rust\n```".into())], &run), ["new.md"]);
    for (name, page) in pages() {
        for block in split_fences(&page).0 {
            // A block without a language would be Rust to rustdoc and nothing to mdBook; and one that
            // is not run says nothing.
            let known =
                ["rust", "text", "sh", "toml", "ini", "python", "c", "cpp", "cmake", "yaml"];
            assert!(known.contains(&block.language), "{name}: a block of '{}'", block.language);
        }
    }
}

/// Files of `examples` that a page says that it shows, and does not show word by word.
fn not_shown(page: &str) -> Vec<String> {
    let (blocks, outside) = split_fences(page);
    let shown = outside.iter().filter_map(|line| {
        let (_, link) = line.strip_prefix("This is [")?.split_once("](")?;
        link.strip_suffix("):")
    });
    let text_of = |block: &Fenced<'_>| block.lines.join("\n") + "\n";
    let is_missing = |link: &&str| {
        let file = read(&pages_folder().join(link));
        !blocks.iter().any(|block| text_of(block) == file)
    };
    shown.filter(is_missing).map(str::to_owned).collect()
}

#[test]
fn examples_on_pages_are_the_files() {
    for (name, page) in pages() {
        assert_eq!(not_shown(&page), [""; 0], "{name}: paste them again");
        // A directive shows as it is where mdBook does not read it.
        assert!(!page.contains("{{#"), "{name}");
    }
    let start = read(&pages_folder().join("start-c.md"));
    assert_eq!(not_shown(&start.replacen("PM_OK", "PM_OKAY", 1)).len(), 1);
}

#[test]
fn quoted_error_texts_are_those_of_the_sources() {
    let texts = source_texts();
    let stale: Vec<String> = quoted_texts().into_iter().filter(|t| !texts.contains(t)).collect();
    assert!(stale.is_empty(), "no source has these texts: {stale:#?}");
}

/// Files whose every error text is quoted: what a client or `serve` meets first.
const ALL_QUOTED: [&str; 5] = [
    "src/session/error.rs",
    "transport/src/error.rs",
    "transport/src/room.rs",
    "wire/src/name.rs",
    "../daemon/src/serve/mod.rs",
];

#[test]
fn no_error_of_sessions_or_of_serving_is_left_out() {
    let quoted = quoted_texts();
    for file in ALL_QUOTED {
        let texts: Vec<String> = texts_of(&read(&crate_root().join(file))).collect();
        assert!(!texts.is_empty(), "{file}");
        for text in texts {
            // Texts that only join those of other errors have no words.
            let has_words = text.split('…').any(|part| part.contains(char::is_alphabetic));
            let is_joined = text == "…: use Backend::Auto";
            assert!(!has_words || is_joined || quoted.contains(&text), "{file}: {text}");
        }
    }
}

#[test]
fn every_status_of_the_daemon_is_explained() {
    let source = read(&crate_root().join("wire/src/status_code.rs"));
    let names: Vec<String> =
        source.split("=> \"").skip(1).filter_map(|after| literal(&format!("\"{after}"))).collect();
    assert!(names.len() > 10 && names.contains(&"bad-request".to_owned()), "{names:?}");
    let page = read(&pages_folder().join("troubleshooting.md"));
    for name in names.iter().filter(|name| *name != "ok") {
        assert!(page.contains(&format!("| `{name}` |")), "{name}");
    }
}

#[test]
fn texts_are_read_as_they_are_shown() {
    let source = r#"
        #[error(transparent)]
        A(B),
        #[error("no {what} for {0:?}: give \"{{}}\"")]
        C,
        #[error(
            "two \
             lines"
        )]
        log::warn!("folder {} is not used: {error}", path.display());
    "#;
    let texts: Vec<String> = texts_of(source).collect();
    let expected = ["no … for …: give \"{}\"", "two lines", "folder … is not used: …"];
    assert_eq!(texts, expected);
}
