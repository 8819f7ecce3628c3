//! Records toolchain and commit of this build, for `--version` and for benchmark records.

use std::process::Command;

fn main() {
    let compiler = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let toolchain = first_line(Command::new(compiler).arg("--version"));
    let commit = packaged_commit().unwrap_or_else(|| {
        first_line(Command::new("git").args(["describe", "--always", "--dirty", "--tags"]))
    });
    println!("cargo::rustc-env=PAIRMASK_TOOLCHAIN={toolchain}");
    println!("cargo::rustc-env=PAIRMASK_COMMIT={commit}");
    println!("cargo::rerun-if-changed=build.rs");
    // The head's own log changes with every commit, checkout and reset. In a source tree without
    // history there is none to watch.
    let head = first_line(Command::new("git").args(["rev-parse", "--git-path", "logs/HEAD"]));
    if std::path::Path::new(&head).exists() {
        println!("cargo::rerun-if-changed={head}");
    }
}

/// The commit of a package's sources: cargo writes it beside the manifest of a package. Git would be asked about
/// whichever repository the package was unpacked in.
fn packaged_commit() -> Option<String> {
    let text = std::fs::read_to_string(".cargo_vcs_info.json").ok()?;
    let after = text.split("\"sha1\": \"").nth(1)?;
    after.split('"').next().map(|commit| commit.chars().take(9).collect())
}

/// The first line of a command's output, or `unknown` where it cannot be run or fails.
fn first_line(command: &mut Command) -> String {
    command
        .output()
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .and_then(|text| text.lines().next().map(str::to_owned))
        .unwrap_or_else(|| "unknown".to_owned())
}
