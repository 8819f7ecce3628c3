//! The graph of which modules of a crate use which others, read from its source.
//!
//! The top-level modules of a crate are layers if they have no cycle: then there is an order in
//! which each uses only those before it. The compiler does not check that.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::{fs, io};

/// The top-level modules of a crate, each with those that it uses.
#[derive(Debug, Default)]
pub struct ModuleGraph {
    uses: BTreeMap<String, BTreeSet<String>>,
}

impl ModuleGraph {
    /// The graph of the crate whose `lib.rs` lies in `src`, without tests and comments.
    ///
    /// # Errors
    /// The file system's error.
    pub fn of_crate(src: &Path) -> io::Result<Self> {
        let mut graph = Self::default();
        for entry in fs::read_dir(src)? {
            let path = entry?.path();
            let Some(module) = path.file_stem().and_then(|stem| stem.to_str()) else { continue };
            if module != "lib" && module != "main" {
                graph.read(module, &path)?;
            }
        }
        Ok(graph)
    }

    /// Adds the modules that a file, or all files of a folder, of `module` use.
    fn read(&mut self, module: &str, path: &Path) -> io::Result<()> {
        if path.is_dir() {
            for entry in fs::read_dir(path)? {
                self.read(module, &entry?.path())?;
            }
        } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with("tests.rs") {
            self.add(module, &fs::read_to_string(path)?);
        }
        Ok(())
    }

    /// Adds the modules that source text of `module` uses.
    pub fn add(&mut self, module: &str, source: &str) {
        let uses = self.uses.entry(module.to_owned()).or_default();
        // By convention the tests of a file stand at its end.
        let code = source.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
        let lines = code.lines().map(|line| line.split("//").next().unwrap_or_default());
        let code: String = lines.collect::<Vec<_>>().join("\n");
        for after in code.split("crate::").skip(1) {
            let names = match after.strip_prefix('{') {
                Some(group) => first_names(group),
                None => vec![first_name(after)],
            };
            uses.extend(names.into_iter().filter(|name| *name != module).map(str::to_owned));
        }
    }

    /// The number of modules.
    pub fn len(&self) -> usize {
        self.uses.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.uses.is_empty()
    }

    /// The modules in an order in which each uses only those before it.
    ///
    /// # Errors
    /// The modules that use each other in a cycle, and those that use them.
    pub fn layers(&self) -> Result<Vec<&str>, Vec<&str>> {
        let mut order: Vec<&str> = Vec::new();
        loop {
            let left = || self.uses.iter().filter(|(name, _)| !order.contains(&name.as_str()));
            let is_placed =
                |name: &String| order.contains(&name.as_str()) || !self.uses.contains_key(name);
            let next: Vec<&str> = left()
                .filter(|(_, uses)| uses.iter().all(is_placed))
                .map(|(name, _)| name.as_str())
                .collect();
            if next.is_empty() {
                let stuck: Vec<&str> = left().map(|(name, _)| name.as_str()).collect();
                return if stuck.is_empty() { Ok(order) } else { Err(stuck) };
            }
            order.extend(next);
        }
    }
}

/// The first name of a path.
fn first_name(path: &str) -> &str {
    path.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default()
}

/// The first names of the paths in a group, up to its closing brace.
fn first_names(group: &str) -> Vec<&str> {
    let mut depth = 0usize;
    let mut names = Vec::new();
    let mut start = 0;
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' | ',' if depth == 0 => {
                names.push(first_name(group[start..at].trim_start()));
                start = at + 1;
                if c == '}' {
                    break;
                }
            }
            '}' => depth -= 1,
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}
