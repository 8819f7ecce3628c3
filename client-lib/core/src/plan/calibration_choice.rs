//! Which constants a plan computes with.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::calibration::Calibration;
#[cfg(feature = "calibration-file")]
use super::calibration_file::{default_path, load};
#[cfg(feature = "calibration-file")]
use super::machine::MachineKey;
use crate::engine::{AvailableIsa, Isa};

/// Which constants a plan computes with.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CalibrationChoice {
    /// Those of this machine in the user's cache directory, else the built-in ones.
    #[default]
    Auto,
    /// The built-in ones.
    BuiltIn,
    /// Those of a file.
    File(PathBuf),
}

impl FromStr for CalibrationChoice {
    type Err = std::convert::Infallible;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        Ok(match s {
            "auto" => Self::Auto,
            "built-in" => Self::BuiltIn,
            path => Self::File(path.into()),
        })
    }
}

impl fmt::Display for CalibrationChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::BuiltIn => f.write_str("built-in"),
            Self::File(path) => path.display().fmt(f),
        }
    }
}

/// Where constants are from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CalibrationOrigin {
    /// Built in, for an instruction set.
    BuiltIn(Isa),
    /// A file that `pairmaskd calibrate` wrote.
    File(PathBuf),
}

impl fmt::Display for CalibrationOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BuiltIn(isa) => write!(f, "built in for {isa}"),
            Self::File(path) => path.display().fmt(f),
        }
    }
}

impl CalibrationChoice {
    /// The constants of engines that use `isa`, and where they are from. A file that cannot be used
    /// is named in the log, and the built-in constants stand in: so it is with every file in a build
    /// without the feature `calibration-file`.
    pub fn resolve(&self, isa: AvailableIsa) -> (Calibration, CalibrationOrigin) {
        let isa = isa.get();
        let kept = match self {
            Self::BuiltIn => None,
            Self::Auto => kept_for_this_machine(isa),
            Self::File(path) => kept_in(path, isa),
        };
        kept.unwrap_or_else(|| (Calibration::built_in(isa), CalibrationOrigin::BuiltIn(isa)))
    }
}

#[cfg(feature = "calibration-file")]
fn kept_for_this_machine(isa: Isa) -> Option<(Calibration, CalibrationOrigin)> {
    let path = default_path(&MachineKey::with_isa(isa))?;
    if path.exists() { kept_in(&path, isa) } else { None }
}

#[cfg(feature = "calibration-file")]
fn kept_in(path: &Path, isa: Isa) -> Option<(Calibration, CalibrationOrigin)> {
    match load(path, &MachineKey::with_isa(isa)) {
        Ok(calibration) => Some((calibration, CalibrationOrigin::File(path.to_owned()))),
        Err(error) => {
            log::warn!("calibration {} is not used: {error}", path.display());
            None
        }
    }
}

#[cfg(not(feature = "calibration-file"))]
const fn kept_for_this_machine(_: Isa) -> Option<(Calibration, CalibrationOrigin)> {
    None
}

#[cfg(not(feature = "calibration-file"))]
fn kept_in(path: &Path, _: Isa) -> Option<(Calibration, CalibrationOrigin)> {
    log::warn!("calibration {} is not used: this build reads no files", path.display());
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_read_as_they_are_written() {
        let file = CalibrationChoice::File("some/where".into());
        for choice in [CalibrationChoice::Auto, CalibrationChoice::BuiltIn, file.clone()] {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        for isa in Isa::ALL.into_iter().filter_map(AvailableIsa::new) {
            assert_eq!(file.resolve(isa).1, CalibrationOrigin::BuiltIn(isa.get()));
        }
    }
}
