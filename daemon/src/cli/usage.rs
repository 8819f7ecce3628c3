//! Messages about a wrong command line in one line: clap's have three to seven.

use std::error::Error as _;
use std::ffi::{OsStr, OsString};

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, Error};

/// The mistake in `arguments`, and the help that says more.
pub fn one_line(error: &Error, command: &Command, arguments: &[OsString]) -> String {
    let path = command_path(command, arguments);
    let innermost = path.last().copied().unwrap_or(command);
    let names: Vec<&str> = path.iter().map(|command| command.get_name()).collect();
    let what = what(error, innermost, arguments);
    format!("{what}: see `{} --help`", names.join(" "))
}

fn command_path<'a>(command: &'a Command, arguments: &[OsString]) -> Vec<&'a Command> {
    let mut path = vec![command];
    let mut innermost = command;
    let mut words = arguments.iter().skip(1).filter_map(|word| word.to_str());
    while let Some(word) = words.next() {
        if let Some(found) = innermost.find_subcommand(word) {
            innermost = found;
            path.push(found);
        } else if takes_value(command, word) {
            words.next();
        }
    }
    path
}

/// Whether a word before the command is a flag with its value in the next word.
fn takes_value(command: &Command, word: &str) -> bool {
    let flag = command.get_arguments().find(|arg| word.strip_prefix("--") == arg.get_long());
    flag.is_some_and(|arg| arg.get_long().is_some() && arg.get_action().takes_values())
}

fn what(error: &Error, command: &Command, arguments: &[OsString]) -> String {
    let text = |kind| error.get(kind).map(words).unwrap_or_default();
    let (flag, value) = (text(ContextKind::InvalidArg), text(ContextKind::InvalidValue));
    match error.kind() {
        ErrorKind::MissingSubcommand | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            format!("a command is missing, one of {}", visible_commands(command))
        }
        ErrorKind::InvalidSubcommand => {
            let name = text(ContextKind::InvalidSubcommand);
            format!("there is no command '{name}', but {}", visible_commands(command))
        }
        ErrorKind::UnknownArgument => match error.get(ContextKind::SuggestedArg).map(words) {
            Some(known) => format!("'{flag}' is not known here, did you mean {known}?"),
            None => format!("'{flag}' is not known here"),
        },
        ErrorKind::InvalidValue if value.is_empty() => format!("{} needs a value", bare(&flag)),
        ErrorKind::InvalidValue => {
            let given = given(&flag, &value, command, arguments);
            format!("{given}: choose one of {}", text(ContextKind::ValidValue))
        }
        ErrorKind::ValueValidation => {
            let given = given(&flag, &value, command, arguments);
            match error.source() {
                Some(why) => format!("{given}: {why}"),
                None => given,
            }
        }
        ErrorKind::MissingRequiredArgument => format!("{flag} is missing"),
        ErrorKind::ArgumentConflict => {
            let other = text(ContextKind::PriorArg);
            if bare(&flag) == bare(&other) || other.is_empty() {
                format!("{} is given more than once", bare(&flag))
            } else {
                format!("{} and {} exclude each other", bare(&flag), bare(&other))
            }
        }
        ErrorKind::TooManyValues => format!("{} takes no value like '{value}'", bare(&flag)),
        _ => first_line(error),
    }
}

/// The wrong value and its origin: a flag, or an environment variable.
fn given(flag: &str, value: &str, command: &Command, arguments: &[OsString]) -> String {
    let flag = bare(flag);
    let long = flag.strip_prefix("--");
    let arg = long.and_then(|long| {
        command.get_arguments().find(|arg| arg.get_long() == Some(long)).zip(Some(long))
    });
    match arg.and_then(|(arg, long)| Some((arg.get_env()?, long))) {
        Some((variable, long)) if !is_typed(long, arguments) => {
            format!("'{value}' in {}", variable.to_string_lossy())
        }
        _ => format!("'{value}' for {flag}"),
    }
}

fn is_typed(long: &str, arguments: &[OsString]) -> bool {
    arguments.iter().filter_map(|word| word.to_str()?.strip_prefix("--")).any(|word| {
        word.strip_prefix(long).is_some_and(|rest| rest.is_empty() || rest.starts_with('='))
    })
}

fn visible_commands(command: &Command) -> String {
    let visible = command.get_subcommands().filter(|one| !one.is_hide_set());
    visible.map(Command::get_name).collect::<Vec<_>>().join(", ")
}

/// A flag without the name of its value; a value without a flag unchanged.
fn bare(flag: &str) -> &str {
    if flag.starts_with('-') { flag.split([' ', '=', '[']).next().unwrap_or(flag) } else { flag }
}

fn words(value: &ContextValue) -> String {
    match value {
        ContextValue::String(one) => one.clone(),
        ContextValue::Strings(many) => many.join(", "),
        other => other.to_string(),
    }
}

fn first_line(error: &Error) -> String {
    let text = error.to_string();
    let line = text.lines().next().unwrap_or_default();
    line.strip_prefix("error: ").unwrap_or(line).to_owned()
}

/// Whether a variable is blank, which counts as not set.
pub fn is_blank(variable: &OsStr) -> bool {
    std::env::var_os(variable).is_some_and(|value| value.is_empty())
}
