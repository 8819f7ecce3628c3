//! Checks of the documents: the targets of links exist.

use std::path::{Path, PathBuf};
use std::{fs, io};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// All Markdown files below a folder; without those of builds and hidden folders.
fn documents(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            documents(&path, found)?;
        } else if path.extension().is_some_and(|e| e == "md") {
            found.push(path);
        }
    }
    Ok(())
}

/// The targets of a text's links that are files: not those to the web, nor within the page.
fn file_links(text: &str) -> impl Iterator<Item = &str> {
    let targets = text.split("](").skip(1).filter_map(|after| after.split(')').next());
    let files = targets.filter(|target| !target.contains("://") && !target.starts_with('#'));
    files.filter_map(|target| target.split('#').next())
}

#[test]
fn links_lead_to_files() {
    let mut found = Vec::new();
    documents(&root(), &mut found).expect("the repository's folders");
    let mut links = 0;
    let mut broken = Vec::new();
    for document in found {
        let text = fs::read_to_string(&document).expect("text");
        let folder = document.parent().expect("a file lies in a folder");
        for link in file_links(&text) {
            links += 1;
            if !folder.join(link).exists() {
                broken.push(format!("{} → {link}", document.display()));
            }
        }
    }
    assert!(links > 30, "{links} links: read from the wrong place?");
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn a_broken_link_is_seen() {
    let links: Vec<&str> = file_links("[a](x/y.rs#l) [b](https://z) [c](#d) ![e](f.svg)").collect();
    assert_eq!(links, ["x/y.rs", "f.svg"]);
}
