//! Which machine constants belong to.

use std::fmt;
use std::fs::File;
use std::io::Read;

use crate::engine::Isa;

/// Bytes of `/proc/cpuinfo` that hold its first processor. The rest is not read: the kernel asks
/// every processor for its clock, which takes milliseconds on large machines.
const FIRST_PROCESSOR_BYTES: u64 = 4096;
/// What tells one processor from another, on x86-64 and on aarch64.
const FIELDS: [&str; 9] = [
    "vendor_id",
    "cpu family",
    "model",
    "stepping",
    "model name",
    "CPU implementer",
    "CPU architecture",
    "CPU variant",
    "CPU part",
];

/// A machine as far as the cost model goes: processor, instruction set and number of cores. Two
/// machines of one key take the same time for the same work.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct MachineKey(String);

impl MachineKey {
    /// The key of this machine with its widest instruction set, as far as this process may use it.
    pub fn this() -> Self {
        Self::with_isa(Isa::best())
    }

    /// The same for engines that use another of its instruction sets.
    pub fn with_isa(isa: Isa) -> Self {
        let mut cpuinfo = Vec::new();
        // Without it the key says less, and so do all keys of such a machine.
        if let Ok(file) = File::open("/proc/cpuinfo") {
            let _ = file.take(FIRST_PROCESSOR_BYTES).read_to_end(&mut cpuinfo);
        }
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self::new(&String::from_utf8_lossy(&cpuinfo), isa, cores)
    }

    fn new(cpuinfo: &str, isa: Isa, cores: usize) -> Self {
        let first = cpuinfo.lines().take_while(|line| !line.trim().is_empty());
        let fields = first.filter_map(|line| {
            let (name, value) = line.split_once(':')?;
            let name = name.trim();
            FIELDS.contains(&name).then(|| format!("{name} {}", value.trim()))
        });
        let own = [isa.to_string(), format!("{cores} cores")];
        Self(fields.chain(own).collect::<Vec<_>>().join("; "))
    }

    /// The key as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// A name for files of this machine: FNV-1a of the key. A collision is harmless, since files
    /// hold the key itself.
    #[cfg(any(test, feature = "calibration-file"))]
    pub(super) fn file_name(&self) -> String {
        let fold = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        let hash = self.0.bytes().fold(0xcbf2_9ce4_8422_2325, fold);
        format!("calibration-{hash:016x}.toml")
    }
}

impl fmt::Display for MachineKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO_PROCESSORS: &str = "processor\t: 0\nvendor_id\t: AuthenticAMD\ncpu family\t: 25\n\
        model\t\t: 17\nmodel name\t: AMD EPYC\ncpu MHz\t\t: 2596.140\n\nprocessor\t: 1\nmodel\t: 99\n";

    #[test]
    fn the_key_is_the_processor_and_not_its_clock() {
        let key = MachineKey::new(TWO_PROCESSORS, Isa::Avx512, 2);
        let text =
            "vendor_id AuthenticAMD; cpu family 25; model 17; model name AMD EPYC; avx512; 2 cores";
        assert_eq!(key.as_str(), text);
        assert_eq!(MachineKey::this(), MachineKey::this());
    }

    #[test]
    fn other_cores_and_instruction_sets_are_other_machines() {
        let keys = [
            MachineKey::new(TWO_PROCESSORS, Isa::Avx512, 2),
            MachineKey::new(TWO_PROCESSORS, Isa::Avx512, 4),
            MachineKey::new(TWO_PROCESSORS, Isa::Avx2, 2),
            MachineKey::new("", Isa::Portable, 2),
        ];
        for (i, a) in keys.iter().enumerate() {
            for b in &keys[..i] {
                assert_ne!(a.file_name(), b.file_name());
            }
        }
    }
}
