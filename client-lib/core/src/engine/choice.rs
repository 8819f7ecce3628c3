//! Which engine: the one that is asked for, and the one that answered.

use std::fmt;
use std::str::FromStr;

use super::EngineName;
use crate::unknown_name::UnknownName;

/// The engine that answered a frame: a later daemon may have one that this build does not know.
/// Its masks are as good.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EngineId {
    /// One that this build knows.
    Known(EngineName),
    /// The wire number of another.
    Unknown(u32),
}

impl EngineId {
    /// The engine of a wire number.
    pub fn from_wire(value: u32) -> Self {
        EngineName::from_wire(value).map_or(Self::Unknown(value), Self::Known)
    }

    /// The engine, where this build knows it.
    pub const fn known(self) -> Option<EngineName> {
        match self {
            Self::Known(name) => Some(name),
            Self::Unknown(_) => None,
        }
    }
}

impl From<EngineName> for EngineId {
    fn from(name: EngineName) -> Self {
        Self::Known(name)
    }
}

impl PartialEq<EngineName> for EngineId {
    fn eq(&self, name: &EngineName) -> bool {
        self.known() == Some(*name)
    }
}

impl fmt::Display for EngineId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Known(name) => name.fmt(f),
            Self::Unknown(number) => write!(f, "engine {number}"),
        }
    }
}

/// A client's options: one engine, or whichever the plan finds fastest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum EngineChoice {
    /// The plan chooses.
    #[default]
    Auto,
    /// This engine and no other.
    Only(EngineName),
}

impl FromStr for EngineChoice {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        if s == "auto" {
            return Ok(Self::Auto);
        }
        EngineName::from_name(s).map(Self::Only).ok_or_else(|| UnknownName {
            name: s.to_owned(),
            known: format!("auto, {}", EngineName::listed(", ")).into(),
        })
    }
}

impl fmt::Display for EngineChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Only(name) => name.fmt(f),
        }
    }
}
