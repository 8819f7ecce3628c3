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

/// A wrong command line.
#[derive(Debug, PartialEq, Eq)]
pub enum ArgumentError {
    /// Not one of the flags.
    Unknown { flag: String },
    /// A flag without a value, or with a wrong one.
    Value { flag: String, why: String },
}

impl Display for ArgumentError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unknown { flag } => {
                write!(f, "unknown flag '{flag}': use --backend, --boxes or --frames")
            }
            Self::Value { flag, why } => write!(f, "{flag}: {why}"),
        }
    }
}

impl std::error::Error for ArgumentError {}

impl Arguments {
    /// Reads flags, each followed by its value.
    pub fn parse(mut words: impl Iterator<Item = String>) -> Result<Self, ArgumentError> {
        let mut arguments = Self { backend: Backend::Auto, boxes: 500, frames: 1000 };
        while let Some(flag) = words.next() {
            let value = words.next();
            match flag.as_str() {
                "--backend" => arguments.backend = parsed(flag, value)?,
                "--boxes" => arguments.boxes = parsed(flag, value)?,
                "--frames" => arguments.frames = parsed(flag, value)?,
                _ => return Err(ArgumentError::Unknown { flag }),
            }
        }
        Ok(arguments)
    }
}

fn parsed<T: FromStr<Err: Display>>(
    flag: String,
    value: Option<String>,
) -> Result<T, ArgumentError> {
    let why = match value.map(|value| value.parse()) {
        Some(Ok(value)) => return Ok(value),
        Some(Err(error)) => error.to_string(),
        None => "a value is missing".to_owned(),
    };
    Err(ArgumentError::Value { flag, why })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Arguments, ArgumentError> {
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
