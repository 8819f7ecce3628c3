//! What the list of engines becomes: their names, each with its descriptor.

use std::fmt;

use super::{AvailableIsa, Engine, EngineName};

/// Declares [`EngineName`] from the list of all engines and their descriptors.
macro_rules! engines {
    ($($(#[$doc:meta])* $name:ident => $descriptor:path,)+) => {
        /// The engines by name. Numbers are part of the wire contract, names of the command line's.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u32)]
        #[non_exhaustive]
        pub enum EngineName {
            $($(#[$doc])* $name = $descriptor.wire_number,)+
        }

        impl EngineName {
            /// Every engine. Of two that take the same time the plan takes the first.
            pub const ALL: [Self; [$(stringify!($name)),+].len()] = [$(Self::$name),+];

            /// Its place in [`Self::ALL`].
            pub const fn ordinal(self) -> usize {
                enum Place {
                    $($name),+
                }
                match self {
                    $(Self::$name => Place::$name as usize,)+
                }
            }

            /// What is known of the engine.
            pub const fn descriptor(self) -> &'static EngineDescriptor {
                match self {
                    $(Self::$name => &$descriptor,)+
                }
            }
        }
    };
}
pub(super) use engines;

impl EngineName {
    /// The engines of the CPU, in the order of [`Self::ALL`].
    pub const CPU: [Self; cpu_count()] = {
        let mut cpu = [Self::ALL[0]; cpu_count()];
        let (mut i, mut count) = (0, 0);
        while i < Self::ALL.len() {
            if !Self::ALL[i].is_gpu() {
                cpu[count] = Self::ALL[i];
                count += 1;
            }
            i += 1;
        }
        cpu
    };

    /// The name on the command line and in reports.
    pub const fn as_str(self) -> &'static str {
        self.descriptor().name
    }

    /// The engine of a wire number, if there is one.
    pub fn from_wire(value: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|e| *e as u32 == value)
    }

    /// The engine of a name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|engine| engine.as_str() == name)
    }

    /// All names for a text, the last one after `last`: ", " or " or ".
    pub fn listed(last: &str) -> String {
        let names = Self::ALL.map(Self::as_str);
        let (end, most) = names.split_last().unwrap_or((&"", &[]));
        [&most.join(", "), *end].join(last)
    }

    /// Whether the engine needs a GPU.
    pub const fn is_gpu(self) -> bool {
        self.descriptor().cpu().is_none()
    }
}

/// One of each CPU engine, in the order of [`EngineName::CPU`], with empty scratch memory.
pub(crate) fn cpu_engines(isa: AvailableIsa) -> [Box<dyn Engine>; EngineName::CPU.len()] {
    EngineName::CPU.map(|name| match name.descriptor().cpu() {
        Some(cpu) => (cpu.make)(isa),
        None => unreachable!("{name} is an engine of the CPU"),
    })
}

impl fmt::Display for EngineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

const fn cpu_count() -> usize {
    let (mut i, mut count) = (0, 0);
    while i < EngineName::ALL.len() {
        count += !EngineName::ALL[i].is_gpu() as usize;
        i += 1;
    }
    count
}
