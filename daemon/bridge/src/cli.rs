//! The command line.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use clap::{Args, Parser, ValueEnum};
use pairmask::AtEnd;
use pairmask_bridge::bridge::{Bridge, BridgeError, Settings};
use pairmask_bridge::ids::{MachineId, Peer};
use pairmask_bridge::member::Place;
use pairmask_bridge::zenoh_link::Meeting;

const EXAMPLES: &str = "\
Examples:
  The same on two machines, of which one has the address 10.0.0.1:
    pairmask-bridge --join tcp/10.0.0.1:7447 --scene town
  Ghosts from 5 units on before a border, reports of pairs between machines as lines of JSON:
    pairmask-bridge --join tcp/10.0.0.1:7447 --scene town --margin 5 --json
  Where all bridges of the scene stand:
    pairmask-bridge status --join tcp/10.0.0.1:7447 --scene town

A daemon has to serve on each machine: pairmaskd serve";

/// Joins the shared scene of this machine to those of the same name on other machines.
#[derive(Debug, Parser)]
#[command(version, after_help = EXAMPLES)]
pub struct Arguments {
    /// Instead of joining.
    command: Option<Command>,
    /// Where bridges meet: an endpoint of one of the machines, or of a router of Zenoh.
    #[arg(long, value_name = "ENDPOINT", env = "PAIRMASK_BRIDGE_JOIN")]
    join: String,
    /// The shared scene.
    #[arg(long, value_name = "NAME", env = "PAIRMASK_BRIDGE_SCENE")]
    scene: String,
    /// A configuration of Zenoh, for TLS and access control.
    #[arg(long, value_name = "FILE", env = "PAIRMASK_BRIDGE_CONFIG")]
    config: Option<PathBuf>,
    /// Prints JSON: reports of pairs between machines, a line a tick, or statuses.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    run: Run,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Command {
    /// Prints where all bridges of a scene stand: peers, ages of what came from them, bytes.
    Status,
}

#[derive(Debug, Args)]
struct Run {
    /// A number that no other machine has. Else one by the machine's name.
    #[arg(long, value_name = "N")]
    machine: Option<u32>,
    /// How near to another machine's slab a box is a ghost there, before it matters.
    #[arg(long, value_name = "UNITS", default_value_t = 0.0)]
    margin: f32,
    /// Across which axis space is cut into slabs. The same for all.
    #[arg(long, default_value = "x")]
    axis: Axis,
    /// A bridge counts as lost after so long without a message. The same for all.
    #[arg(long, value_name = "MS", default_value_t = 1_000)]
    lease_ms: u32,
    /// How often slabs may follow the boxes; 0: only when machines come or go.
    #[arg(long, value_name = "MS", default_value_t = 5_000)]
    rebalance_ms: u64,
    /// What becomes of a lost machine's ghosts. Else as the scene says.
    #[arg(long)]
    at_end: Option<End>,
    /// How long a tick of the scene waits for a writer. Else as the scene says.
    #[arg(long, value_name = "MS")]
    deadline_ms: Option<u64>,
    /// The daemon's instance.
    #[arg(long, value_name = "NAME", env = "PAIRMASK_INSTANCE")]
    instance: Option<String>,
    /// Ends after so many ticks.
    #[arg(long, value_name = "N")]
    ticks: Option<u64>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Axis {
    X,
    Y,
    Z,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum End {
    Remove,
    Keep,
}

impl Arguments {
    /// Whether only what was asked for is printed.
    pub const fn is_quiet(&self) -> bool {
        self.command.is_some()
    }
}

/// Does what the command line says.
///
/// # Errors
/// [`BridgeError`].
pub fn run(arguments: Arguments) -> Result<(), BridgeError> {
    let Arguments { command, join, scene, config, json, run } = arguments;
    let meeting = Meeting { join, config };
    match command {
        Some(Command::Status) => status(&meeting, scene, json),
        None => bridge(meeting, scene, json, run),
    }
}

fn status(meeting: &Meeting, scene: String, json: bool) -> Result<(), BridgeError> {
    let statuses = meeting.statuses(&scene)?;
    if statuses.is_empty() {
        return Err(BridgeError::NoBridge { scene });
    }
    for status in statuses {
        if json {
            println!("{status}");
        } else {
            print!("{}", pairmask_bridge::bridge::describe(&status)?);
        }
    }
    Ok(())
}

/// Eight digits that stay the same on a machine.
fn machine_of_name() -> u32 {
    let name = std::fs::read("/etc/machine-id").unwrap_or_default();
    let mut hasher = DefaultHasher::new();
    (name, std::fs::read("/etc/hostname").unwrap_or_default()).hash(&mut hasher);
    hasher.finish() as u32
}

fn bridge(meeting: Meeting, scene: String, json: bool, run: Run) -> Result<(), BridgeError> {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let me = Peer {
        machine: MachineId(run.machine.unwrap_or_else(machine_of_name)),
        incarnation: since.as_nanos() as u64,
    };
    let at_end = run.at_end.map(|end| match end {
        End::Remove => AtEnd::Remove,
        End::Keep => AtEnd::Keep,
    });
    let settings = Settings {
        me,
        meeting,
        place: Place {
            scene,
            instance: run.instance,
            at_end,
            deadline: run.deadline_ms.map(Duration::from_millis),
        },
        margin: run.margin.max(0.0),
        axis: run.axis as u8,
        lease_ms: run.lease_ms.clamp(100, 60_000),
        rebalance: (run.rebalance_ms > 0).then(|| Duration::from_millis(run.rebalance_ms)),
        prints_json: json,
    };
    let mut bridge = Bridge::open(settings)?;
    let mut ticks = 0;
    while run.ticks.is_none_or(|most| ticks < most) {
        bridge.tick()?;
        ticks += 1;
    }
    Ok(())
}
