//! Changes to the derived command line that clap has no attributes for.

use clap::{Command, CommandFactory};
use pairmaskd::cli::shape::{ALL, Shape, shaped};

use super::Cli;

const PAIRMASK_LAB: Shape = Shape {
    without_use: &[
        ("mapping", &["instance", "runtime_dir", "isa"]),
        ("grid", &["instance", "runtime_dir", "isa"]),
        ("sweep", &["instance", "runtime_dir", "isa"]),
        ("gpu-scene", &["instance", "runtime_dir", "isa"]),
        ("plan", &["instance", "runtime_dir"]),
        ("threads", ALL),
        ("spheres", ALL),
        ("papers", ALL),
        ("chart", ALL),
    ],
    measuring: &["accuracy", "load"],
};

/// The whole command line.
pub fn command() -> Command {
    shaped(Cli::command(), &PAIRMASK_LAB)
}

#[cfg(test)]
mod tests {
    use std::ffi::OsString;

    use pairmaskd::cli::usage::one_line;

    use super::*;

    fn help(name: &str) -> String {
        let mut built = command();
        built.build();
        let found = built.find_subcommand_mut(name).unwrap_or_else(|| panic!("no command {name}"));
        found.render_long_help().to_string()
    }

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn help_lists_what_a_command_uses_and_every_command_takes_what_is_shared() {
        for (name, _) in PAIRMASK_LAB.without_use {
            assert!(help(name).contains("--help"), "{name}");
        }
        for (name, flag, is_listed) in [
            ("accuracy", "--runtime-dir", true),
            ("grid", "--config", true),
            ("grid", "--instance", false),
            ("plan", "--isa", true),
            ("spheres", "--isa", false),
        ] {
            assert_eq!(help(name).contains(flag), is_listed, "{name}: {}", help(name));
            let words = ["pairmask-lab", flag, "x", name, "--help"];
            let error = command().try_get_matches_from(words).expect_err("help");
            assert_eq!(error.kind(), clap::error::ErrorKind::DisplayHelp, "{name} {flag}");
        }
        assert!(help("accuracy").contains("[default: daemon]"), "{}", help("accuracy"));
    }

    /// No message about a wrong number has Rust's words.
    #[test]
    fn every_number_says_what_it_must_be() {
        let mut built = command();
        built.build();
        let mut tried = 0;
        for inner in built.get_subcommands().filter(|inner| inner.get_name() != "help") {
            for arg in inner.get_arguments().filter(|arg| arg.get_action().takes_values()) {
                let Some(long) = arg.get_long() else { continue };
                for value in ["0", "-1", "x", "", "99999999999999999999999"] {
                    let words = ["pairmask-lab", inner.get_name(), &format!("--{long}={value}")];
                    let words = words.map(OsString::from);
                    let Err(error) = command().try_get_matches_from(&words) else { continue };
                    let text = one_line(&error, &command(), &words);
                    for jargon in [" type", "digit found", "cannot parse", "zero for", "not in "] {
                        assert!(!text.contains(jargon), "{words:?}: {text}");
                    }
                    tried += 1;
                }
            }
        }
        assert!(tried > 60, "{tried}");
    }
}
