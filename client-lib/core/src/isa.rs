//! Instruction sets: which ones this machine has, asked once.

use std::fmt;

/// An instruction set that the CPU engines have kernels for.
///
/// ```
/// use pairmask_core::engine::Isa;
/// assert!(Isa::Portable.is_available());
/// assert!(Isa::best().is_available());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Isa {
    /// x86-64 with AVX-512 F, BW, DQ and VL: 16 columns a register, compares that answer in bits.
    Avx512,
    /// x86-64 with AVX2: 8 columns a register.
    Avx2,
    /// aarch64: 4 columns a register. Every aarch64 has it.
    Neon,
    /// Plain Rust, for all other machines and as the yardstick of the rest.
    Portable,
}

impl Isa {
    /// All of them, widest first.
    pub const ALL: [Self; 4] = [Self::Avx512, Self::Avx2, Self::Neon, Self::Portable];

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
            Self::Neon => cfg!(target_arch = "aarch64"),
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
            Self::Neon => "neon",
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
    pub fn get(self) -> Isa {
        self.0
    }
}
