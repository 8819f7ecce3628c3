//! Output of results and logs.

use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::Path;

use serde::Serialize;

use super::program;
use crate::file_error::{Access, FileError, advice};

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("standard output: {}", advice(Access::Write, .0))]
    Io(#[from] std::io::Error),
    #[error("writing the result as JSON: {0}")]
    Json(#[from] serde_json::Error),
}

/// Variable that says what is logged.
pub(super) const LOG_VARIABLE: &str = "PAIRMASK_LOG";

/// Starts the log on stderr. `PAIRMASK_LOG` takes `error` to `trace`, or a filter by module.
pub fn start_log(default_level: &str) {
    let env = env_logger::Env::new().filter_or(LOG_VARIABLE, default_level);
    env_logger::Builder::from_env(env).format_target(false).init();
}

pub fn print_json(value: &impl Serialize) -> Result<(), OutputError> {
    print_text(&serde_json::to_string_pretty(value)?)
}

pub fn print_text(text: &str) -> Result<(), OutputError> {
    write_stdout(format!("{text}\n").as_bytes())
}

pub fn write_stdout(bytes: &[u8]) -> Result<(), OutputError> {
    let mut stdout = std::io::stdout().lock();
    stdout.write_all(bytes)?;
    stdout.flush()?;
    Ok(())
}

/// Writes a file, or to stdout for `-`.
pub fn write_file(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> program::Result {
    let whole = |mut file: BufWriter<&mut dyn Write>| write(&mut file).and_then(|()| file.flush());
    if is_stdout(path) {
        return Ok(whole(BufWriter::new(&mut std::io::stdout().lock())).map_err(OutputError::Io)?);
    }
    let written = File::create(path).and_then(|mut file| whole(BufWriter::new(&mut file)));
    Ok(written.map_err(FileError::of(path, Access::Write))?)
}

/// Creates the folder of the results before a long run, so that a wrong name fails at once.
pub fn make_folder(folder: Option<&Path>) -> Result<(), FileError> {
    let made =
        |folder| std::fs::create_dir_all(folder).map_err(FileError::of(folder, Access::WriteInto));
    folder.map_or(Ok(()), made)
}

/// Prints text and a line's end on stderr, if stderr can be written to.
pub fn print_aside(text: &str) {
    // No output is left on which a closed or full stderr could be reported.
    let _ = writeln!(std::io::stderr(), "{text}");
}

pub fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

/// Bytes would go to a terminal, which takes some of them for commands.
#[derive(Debug, thiserror::Error)]
#[error("stdout is a terminal, and the result is binary: {cure}")]
pub struct BinaryToTerminal {
    cure: &'static str,
}

/// Checks that binary output for `path` does not go to a terminal, before any work is done for it.
pub fn check_binary(path: &Path, cure: &'static str) -> Result<(), BinaryToTerminal> {
    let is_terminal = is_stdout(path) && std::io::stdout().is_terminal();
    if is_terminal { Err(BinaryToTerminal { cure }) } else { Ok(()) }
}

pub fn time_text(ns: u64) -> String {
    match ns {
        0..1_000 => format!("{ns} ns"),
        1_000..1_000_000 => format!("{:.1} µs", ns as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} ms", ns as f64 / 1e6),
        _ => format!("{:.1} s", ns as f64 / 1e9),
    }
}

/// Bytes in a unit that suits them.
pub fn size_text(bytes: u64) -> String {
    let unit =
        |shift: u32, name: &str| format!("{:.1} {name}", bytes as f64 / (1u64 << shift) as f64);
    match bytes {
        0..0x400 => format!("{bytes} bytes"),
        0x400..0x10_0000 => unit(10, "KiB"),
        0x10_0000..0x4000_0000 => unit(20, "MiB"),
        _ => unit(30, "GiB"),
    }
}

pub fn is_watched() -> bool {
    std::io::stderr().is_terminal()
}

#[cfg(test)]
mod tests {
    use super::{size_text, time_text};

    #[test]
    fn times_have_a_unit_that_suits_them() {
        for (ns, text) in [
            (0, "0 ns"),
            (999, "999 ns"),
            (1_000, "1.0 µs"),
            (12_345_678, "12.3 ms"),
            (12_345_678_901, "12.3 s"),
        ] {
            assert_eq!(time_text(ns), text);
        }
    }

    #[test]
    fn sizes_have_a_unit_that_suits_them() {
        for (bytes, text) in
            [(1023, "1023 bytes"), (1536, "1.5 KiB"), (64 << 20, "64.0 MiB"), (3 << 30, "3.0 GiB")]
        {
            assert_eq!(size_text(bytes), text);
        }
    }
}
