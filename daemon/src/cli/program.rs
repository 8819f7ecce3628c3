//! A program with a command line, from its arguments to its exit status. `pairmaskd` and the
//! laboratory's binary share it.

use std::error::Error;
use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Command, FromArgMatches};

use super::output::{BinaryToTerminal, OutputError, print_aside};
use super::usage;
use crate::serve::ServeError;
use crate::spawn::SpawnError;

/// Exit status: the command failed, or no daemon serves.
pub const FAILED: u8 = 1;
/// Exit status: the command line or the configuration is wrong; clap uses the same number.
pub const USAGE: u8 = 2;

/// Why a command failed, of any type: it is printed. The exit status depends on few types.
pub type Fault = Box<dyn Error + Send + Sync>;

pub type Result<T = (), E = Fault> = std::result::Result<T, E>;

#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WrongUsage(pub String);

/// Whether a child process failed and printed the reason on the same stderr: a second line would add nothing.
fn was_said(fault: &Fault) -> bool {
    let code = match (fault.downcast_ref(), fault.downcast_ref()) {
        (Some(ServeError::Worker { code }), _) => Some(*code),
        (_, Some(SpawnError::Ended { status })) => status.code(),
        _ => None,
    };
    code.is_some_and(|code| [FAILED, USAGE].map(i32::from).contains(&code))
}

/// Parses the arguments of this process and runs what they ask for. A failure is one line on stderr
/// that begins with the program's name. Call it first in `main`: it sets the process up.
pub fn run<C: FromArgMatches>(command: &Command, run: impl FnOnce(&C) -> Result) -> ExitCode {
    silence();
    let arguments: Vec<OsString> = std::env::args_os().collect();
    let done = parse(command, &arguments).and_then(|parsed| parsed.map_or(Ok(()), |cli| run(&cli)));
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_closed_pipe(error.as_ref()) => ExitCode::SUCCESS,
        Err(error) => {
            if !was_said(&error) {
                let name = command.get_name();
                print_aside(&format!("{name}: {}", on_one_line(&error.to_string())));
            }
            let is_usage = error.is::<WrongUsage>() || error.is::<BinaryToTerminal>();
            ExitCode::from(if is_usage { USAGE } else { FAILED })
        }
    }
}

/// `None` where the arguments ask for help or version, which are then printed on stdout.
fn parse<C: FromArgMatches>(command: &Command, arguments: &[OsString]) -> Result<Option<C>> {
    let matches = command.clone().try_get_matches_from(arguments);
    match matches.and_then(|matches| C::from_arg_matches(&matches)) {
        Ok(cli) => Ok(Some(cli)),
        Err(error) if error.use_stderr() => {
            Err(WrongUsage(usage::one_line(&error, command, arguments)).into())
        }
        Err(help) => {
            help.print().map_err(OutputError::from)?;
            Ok(None)
        }
    }
}

/// Without control characters, which names that users give may hold.
fn on_one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// Whether the reader of stdout has exited (`| head`), which is no failure of the command.
fn is_closed_pipe(error: &(dyn Error + 'static)) -> bool {
    let mut cause = error.source();
    while let Some(error) = cause {
        let io = error.downcast_ref::<std::io::Error>();
        if io.is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe) {
            return true;
        }
        cause = error.source();
    }
    false
}

/// Variable that disables Mesa's layer that sorts adapters. The layer asks the display which
/// adapter it runs on, and warns on stderr where there is no display (`XDG_RUNTIME_DIR is invalid or
/// not set`). Pairmask needs no sorting: users choose by `--gpu`. The daemon's worker inherits the
/// variable, so that a number in `--gpu` means the same adapter in every command.
const NO_SORTING_LAYER: &str = "NODEVICE_SELECT";

/// Disables the layer for this process and its children, unless the user has set the variable.
/// Call it first: it changes nothing in a process that has other threads.
pub fn silence() {
    if std::env::var_os(NO_SORTING_LAYER).is_none() {
        set_variable(NO_SORTING_LAYER, "1");
    }
}

/// Sets a variable for this process and its children. Changes nothing in a process that has other threads.
#[allow(unsafe_code)]
pub(super) fn set_variable(name: &str, value: &str) {
    if is_single_threaded() {
        // SAFETY: the environment may be changed while no other thread can read it. The kernel lists one
        // thread for this process, the one that runs here, so that no other can start meanwhile.
        unsafe { std::env::set_var(name, value) };
    }
}

fn is_single_threaded() -> bool {
    std::fs::read_dir("/proc/self/task").is_ok_and(|threads| threads.count() == 1)
}

#[cfg(test)]
mod tests {
    use super::is_single_threaded;

    #[test]
    fn a_process_with_more_threads_is_left_alone() {
        // The test harness runs this in a thread of its own.
        assert!(!is_single_threaded());
    }
}
