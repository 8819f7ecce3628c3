//! Instruction sets: which ones this machine has, asked once.

use std::fmt;
use std::str::FromStr;

use crate::unknown_name::UnknownName;

/// An instruction set that the CPU engines have kernels for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Isa {
    /// x86-64 with AVX-512 F, BW, DQ and VL: 16 columns a register, compares that answer in bits.
    Avx512,
    /// x86-64 with AVX2: 8 columns a register.
    Avx2,
    /// Plain Rust, for all other machines (aarch64 among them) and as the yardstick of the rest.
    Portable,
}

impl Isa {
    /// All of them, widest first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// Whether this machine can run it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && Self::Avx2.is_available()
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Portable => true,
        }
    }

    /// The widest one of this machine.
    pub fn best() -> Self {
        Self::ALL.into_iter().find(|isa| isa.is_available()).unwrap_or(Self::Portable)
    }

    /// The name in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Portable => "portable",
        }
    }
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// An instruction set that this machine is known to have: the proof that kernels ask for.
///
/// Only [`Isa::is_available`] mints one, so holding it is what makes a call into a
/// `target_feature` kernel sound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AvailableIsa(Isa);

/// Why an instruction set that was asked for by name is not used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IsaError {
    /// There is none of that name.
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    /// This machine does not have it.
    #[error("this processor lacks {asked}: the widest set that it has is {widest}")]
    Missing {
        /// The set that was asked for.
        asked: Isa,
        /// The widest one of this machine.
        widest: Isa,
    },
}

impl AvailableIsa {
    /// The widest instruction set of this machine.
    pub fn best() -> Self {
        Self(Isa::best())
    }

    /// `isa`, if this machine has it.
    pub fn new(isa: Isa) -> Option<Self> {
        isa.is_available().then_some(Self(isa))
    }

    /// Which one it is.
    pub const fn get(self) -> Isa {
        self.0
    }
}

impl fmt::Display for AvailableIsa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl FromStr for Isa {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        Self::ALL.into_iter().find(|isa| isa.as_str() == s).ok_or_else(|| UnknownName {
            name: s.to_owned(),
            known: Self::ALL.map(Self::as_str).join(", ").into(),
        })
    }
}

impl FromStr for AvailableIsa {
    type Err = IsaError;

    fn from_str(s: &str) -> Result<Self, IsaError> {
        let asked: Isa = s.parse()?;
        Self::new(asked).ok_or(IsaError::Missing { asked, widest: Isa::best() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_set_of_this_machine_or_a_typed_error() {
        for isa in Isa::ALL {
            assert_eq!(isa.to_string().parse(), Ok(isa));
            let parsed = isa.to_string().parse::<AvailableIsa>();
            let expected =
                AvailableIsa::new(isa).ok_or(IsaError::Missing { asked: isa, widest: Isa::best() });
            assert_eq!(parsed, expected);
        }
        for wrong in ["", "AVX2", "avx", "avx2 "] {
            assert!(matches!(wrong.parse::<AvailableIsa>(), Err(IsaError::Unknown(_))), "{wrong}");
        }
    }
}
