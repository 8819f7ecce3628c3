//! The command line of the example.

use std::fmt::Display;
use std::str::FromStr;

use pairmask::Backend;

/// The size of the simulation and the backend that finds the pairs.
#[derive(Debug, PartialEq, Eq)]
pub struct Arguments {
    pub backend: Backend,
    pub boxes: u32,
    pub frames: u64,
}

impl Arguments {
    /// Reads flags, each followed by its value.
    pub fn parse(mut words: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut arguments = Self { backend: Backend::Auto, boxes: 500, frames: 1000 };
        while let Some(flag) = words.next() {
            let value = words.next();
            match flag.as_str() {
                "--backend" => arguments.backend = parsed(&flag, value)?,
                "--boxes" => arguments.boxes = parsed(&flag, value)?,
                "--frames" => arguments.frames = parsed(&flag, value)?,
                _ => {
                    return Err(format!(
                        "unknown flag '{flag}': use --backend, --boxes or --frames"
                    ));
                }
            }
        }
        Ok(arguments)
    }
}

fn parsed<T: FromStr<Err: Display>>(flag: &str, value: Option<String>) -> Result<T, String> {
    let value = value.ok_or_else(|| format!("{flag}: a value is missing"))?;
    value.parse().map_err(|error| format!("{flag}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Arguments, String> {
        Arguments::parse(line.split_whitespace().map(str::to_owned))
    }

    #[test]
    fn flags_are_read_and_mistakes_named() {
        let expected = Arguments { backend: Backend::InProcess, boxes: 3, frames: 1000 };
        assert_eq!(parse("--boxes 3 --backend in-process"), Ok(expected));
        for wrong in ["--box 3", "--boxes", "--boxes -1", "--backend here"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
