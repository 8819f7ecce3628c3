//! Changes to the derived command line that clap has no attributes for.

use clap::builder::Resettable;
use clap::{Arg, Command, CommandFactory};

use super::Cli;
use super::usage::is_blank;

#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Settings that a command accepts and does not use. Every command accepts the shared settings,
    /// so that a script may write them before the command; the help of a command lists only those
    /// that it uses. Commands by their path (`bench latency`), settings by their id.
    pub without_use: &'static [(&'static str, &'static [&'static str])],
    /// Commands that measure through a session: their default backend is the daemon.
    pub measuring: &'static [&'static str],
}

pub const ALL: &[&str] = &["instance", "runtime_dir", "config", "isa"];

const MEASURED_BACKEND: &str = "Who finds the pairs: daemon (one of its own unless an instance is \
                                named), in-process, or auto (the daemon that serves, else this \
                                process) [default: daemon]";

const PAIRMASKD: Shape = Shape {
    without_use: &[
        ("demo", &["instance", "runtime_dir"]),
        ("advise", &["instance", "runtime_dir"]),
        ("scene", ALL),
        ("explain", ALL),
        ("gpus", ALL),
        ("clean", &["instance", "isa"]),
        ("install-service", &["runtime_dir", "isa"]),
        ("completions", ALL),
        ("man", ALL),
        ("status", &["isa"]),
    ],
    measuring: &["bench latency"],
};

pub(super) fn command() -> Command {
    shaped(Cli::command(), &PAIRMASKD)
}

/// The commands and flags that help lists, for generators that take those which are hidden too.
pub(super) fn listed() -> Command {
    let mut all = command().disable_help_subcommand(true);
    // Passes shared settings on to the commands that have none of their own.
    all.build();
    listed_of(&all)
}

fn listed_of(command: &Command) -> Command {
    // A new command has these two by itself.
    let is_new = |arg: &Arg| !["help", "version"].contains(&arg.get_id().as_str());
    let arguments = command.get_arguments().filter(|arg| !arg.is_hide_set() && is_new(arg));
    let inner = command.get_subcommands().filter(|inner| !inner.is_hide_set()).map(listed_of);
    let listed = Command::new(command.get_name().to_owned())
        .about(command.get_about().cloned().unwrap_or_default())
        .disable_help_subcommand(true)
        .args(arguments.map(|arg| arg.clone().global(false)))
        .subcommands(inner);
    match command.get_version() {
        Some(version) => listed.version(version.to_owned()),
        None => listed,
    }
}

/// Changes a derived command line: unused settings are not listed, negative numbers are values, and
/// blank variables count as not set.
pub fn shaped(command: Command, shape: &Shape) -> Command {
    let shared: Vec<Arg> =
        command.get_arguments().filter(|arg| arg.is_global_set()).cloned().collect();
    shaped_at(command, "", &shared, shape)
}

fn shaped_at(command: Command, path: &str, shared: &[Arg], shape: &Shape) -> Command {
    let without_use = shape.without_use.iter().find(|(name, _)| *name == path);
    let hidden = shared
        .iter()
        .filter(|arg| without_use.is_some_and(|(_, ids)| ids.contains(&arg.get_id().as_str())));
    // clap passes a shared setting on to a command unless the command has one of that name.
    let command = command.args(hidden.map(|arg| arg.clone().hide(true)));
    let command = command.mut_args(|arg| {
        let arg = if shape.measuring.contains(&path) && arg.get_id() == "backend" {
            arg.help(MEASURED_BACKEND)
        } else {
            arg
        };
        // `--threads -1` is a wrong number, not an unknown flag.
        let takes_values = arg.get_action().takes_values();
        let arg = if takes_values { arg.allow_negative_numbers(true) } else { arg };
        if arg.get_env().is_some_and(is_blank) { arg.env(Resettable::Reset) } else { arg }
    });
    command.mut_subcommands(|inner| {
        let path = format!("{path} {}", inner.get_name());
        shaped_at(inner, path.trim_start(), shared, shape)
    })
}

#[cfg(test)]
mod tests {
    use pairmask_tests::command_line::{check_numbers, check_shared, leaves};

    use super::*;

    #[test]
    fn help_lists_what_a_command_uses_and_every_command_takes_what_is_shared() {
        let found = leaves(&command());
        let named = |path: &str| {
            let command = found.iter().find(|(name, _)| name == path);
            command.unwrap_or_else(|| panic!("no command {path}")).1.clone()
        };
        for (path, _) in PAIRMASKD.without_use {
            named(path);
        }
        for (path, flag, is_listed) in [
            ("cull", "--instance", true),
            ("serve", "--isa", true),
            ("status", "--instance", true),
            ("status", "--isa", false),
            ("scene", "--config", false),
            ("explain", "--instance", false),
            ("bench latency", "--runtime-dir", true),
            ("demo", "--config", true),
            ("demo", "--instance", false),
            ("cull", "--isa", true),
        ] {
            let help = named(path).render_long_help().to_string();
            assert_eq!(help.contains(flag), is_listed, "{path}: {help}");
            check_shared(&command(), path);
        }
        for path in PAIRMASKD.measuring {
            let help = named(path).render_help().to_string();
            assert!(help.contains("[default: daemon]"), "{help}");
        }
    }

    #[test]
    fn every_number_says_what_it_must_be() {
        let tried = check_numbers(&command());
        assert!(tried > 100, "{tried}");
    }
}
