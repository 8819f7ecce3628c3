//! The command line of the example.

/// What `--help` prints.
pub const HELP: &str = "\
Four processes write one scene, a fifth listens; one of the four is killed and comes back.

    several_processes [--boxes N] [--ticks N]

  --boxes N   boxes of each writer (25000)
  --ticks N   ticks that the listener counts before all end (300)

A daemon has to serve: pairmaskd serve
";

/// What this process does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Starts the others.
    Starter,
    /// Writes the boxes of one of the ranges.
    Writer(u32),
    /// Listens and prints.
    Listener,
    /// Prints what the flags are.
    Help,
}

/// The size of the example, and the role of this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arguments {
    pub role: Role,
    pub boxes: u32,
    pub ticks: u64,
}

impl Arguments {
    /// Reads flags, each followed by its value.
    pub fn parse(mut words: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut arguments = Self { role: Role::Starter, boxes: 25_000, ticks: 300 };
        while let Some(flag) = words.next() {
            let wrong = || format!("'{flag}' is no flag, or has a wrong value: see --help");
            let mut number = || words.next().and_then(|n| n.parse::<u32>().ok()).ok_or_else(wrong);
            match flag.as_str() {
                "--help" | "-h" => arguments.role = Role::Help,
                "--boxes" => arguments.boxes = number()?.clamp(1, 1 << 20),
                "--ticks" => arguments.ticks = u64::from(number()?).max(1),
                "--listen" => arguments.role = Role::Listener,
                "--write" => arguments.role = Role::Writer(number()?),
                _ => return Err(wrong()),
            }
        }
        Ok(arguments)
    }
}
