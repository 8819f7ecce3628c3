//! What a bug report needs, as one text: nothing of the user but settings of Pairmask, and no name of a home.

use std::fmt::Write;
use std::path::Path;

use serde_json::Value;

use crate::cli::machine::{self, Machine};
use crate::cli::options::CommonOptions;
use crate::cli::status::{Instance, instances};
use crate::path_in;

/// Lines of /proc/meminfo: total, free, available, caches, swap.
const MEMINFO_LINES: usize = 16;

pub(super) fn text(doctor: &str, common: &CommonOptions) -> String {
    let found = instances(&common.runtime_dir(), common.named_instance().as_ref());
    let status = Value::Array(found.iter().map(Instance::json).collect());
    let memory = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let memory: Vec<&str> = memory.lines().take(MEMINFO_LINES).collect();
    let mut text = String::new();
    for (title, part) in [
        ("pairmaskd", machine::version().to_owned()),
        ("machine", Machine::this().to_string()),
        ("doctor", doctor.to_owned()),
        ("status", format!("{status:#}")),
        (
            "environment",
            variables(std::env::vars_os().filter_map(|(name, value)| {
                Some((name.into_string().ok()?, value.to_string_lossy().into_owned()))
            })),
        ),
        ("/proc/meminfo", memory.join("\n")),
    ] {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "## {title}\n\n{}\n", part.trim_end());
    }
    without_homes(&text, path_in("HOME").as_deref())
}

/// Those of Pairmask, sorted.
fn variables(all: impl Iterator<Item = (String, String)>) -> String {
    let ours = all.filter(|(name, _)| name.starts_with("PAIRMASK_"));
    let mut lines: Vec<String> = ours.map(|(name, value)| format!("{name}={value}")).collect();
    lines.sort();
    if lines.is_empty() { "none".to_owned() } else { lines.join("\n") }
}

/// Puts `~` in the place of the user's home, and of any below /home.
fn without_homes(text: &str, home: Option<&Path>) -> String {
    const HOMES: &str = "/home/";
    let home = home.and_then(Path::to_str).map(|home| home.trim_end_matches('/'));
    let text = match home {
        None | Some("") => text.to_owned(),
        Some(home) => text.replace(home, "~"),
    };
    let mut parts = text.split(HOMES);
    let mut shown = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let is_of_name = |c: char| c.is_alphanumeric() || ['-', '_', '.', '@', '$'].contains(&c);
        shown.push('~');
        shown.push_str(part.trim_start_matches(is_of_name));
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_variables_of_ours_are_shown() {
        let all = [("PAIRMASK_GPU", "1"), ("SECRET", "x"), ("PAIRMASK_BACKEND", "auto")];
        let all = all.map(|(name, value)| (name.to_owned(), value.to_owned()));
        assert_eq!(variables(all.into_iter()), "PAIRMASK_BACKEND=auto\nPAIRMASK_GPU=1");
        assert_eq!(variables(std::iter::empty()), "none");
    }

    #[test]
    fn homes_have_no_names() {
        let text = "/srv/ann/run, /home/bob-2/x: /home/eve and /homes";
        let shown = "~/run, ~/x: ~ and /homes";
        assert_eq!(without_homes(text, Some(Path::new("/srv/ann/"))), shown);
        assert_eq!(without_homes(text, Some(Path::new("/"))), "/srv/ann/run, ~/x: ~ and /homes");
        assert_eq!(without_homes("nothing", None), "nothing");
    }
}
