//! A bridge at work: the member, the link and the node between them, tick by tick of the local scene.

use std::collections::BTreeMap;
use std::io::Write;
use std::time::{Duration, Instant};

use pairmask_core::engine::CullError;
use serde::{Deserialize, Serialize};

use crate::ids::{BoxId, PairId, Peer};
use crate::member::{Member, Place};
use crate::node::{Config, Node, Report};
use crate::protocol::{Refused, Terms};
use crate::zenoh_link::{LinkError, Meeting, ZenohLink};

/// How long the next tick waits where the daemon does not answer.
const PAUSE: Duration = Duration::from_millis(50);
/// Ticks are no shorter: a scene that nobody else writes would tick as fast as the bridge commits. A game beside it may tick
/// at 250 Hz.
const SHORTEST_TICK: Duration = Duration::from_millis(4);
/// How often the status is made anew.
const STATUS_INTERVAL: Duration = Duration::from_millis(250);

/// Why a bridge ends, or does not begin.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BridgeError {
    /// The shared scene.
    #[error("the shared scene: {0}")]
    Scene(#[from] pairmask::Error),
    /// The link.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Too many pairs between machines.
    #[error("pairs between machines: {0}")]
    Cull(#[from] CullError),
    /// Nobody answers.
    #[error("no bridge of scene '{scene}' answers")]
    NoBridge {
        /// The scene.
        scene: String,
    },
    /// Not a status.
    #[error("not a status: {0}")]
    Status(#[from] serde_json::Error),
    /// Nobody reads the reports.
    #[error("printing a report: {0}")]
    Print(#[from] std::io::Error),
}

/// What a bridge is started with.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Who it is.
    pub me: Peer,
    /// Where it meets others.
    pub meeting: Meeting,
    /// Its scene.
    pub place: Place,
    /// The margin of ghosts.
    pub margin: f32,
    /// The axis.
    pub axis: u8,
    /// The lease.
    pub lease_ms: u32,
    /// How often cuts may follow the boxes.
    pub rebalance: Option<Duration>,
    /// Whether reports are printed as lines of JSON.
    pub prints_json: bool,
}

/// A status, as it is sent.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct StatusText {
    machine: u32,
    tick: u64,
    report_age: u64,
    view: u64,
    cuts: Vec<f32>,
    boxes: usize,
    ghosts: usize,
    pairs: usize,
    missing: Vec<u32>,
    sent_bytes: u64,
    received_bytes: u64,
    dropped: u64,
    refused: BTreeMap<String, u64>,
    peers: Vec<PeerText>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct PeerText {
    machine: u32,
    age: u64,
    ghosts: usize,
    unacknowledged_bytes: usize,
}

/// A status for people.
///
/// # Errors
/// [`BridgeError::Status`].
pub fn describe(status: &str) -> Result<String, BridgeError> {
    use std::fmt::Write as _;
    let status: StatusText = serde_json::from_str(status)?;
    let StatusText { machine, tick, report_age, boxes, ghosts, pairs, .. } = &status;
    let StatusText { sent_bytes, received_bytes, cuts, missing, .. } = &status;
    let mut text = String::new();
    let _ = writeln!(
        text,
        "machine {machine}: tick {tick}, reports {report_age} ticks old, {boxes} boxes, {ghosts} ghosts, {pairs} pairs \
         between machines, {sent_bytes} bytes sent, {received_bytes} received, borders at {cuts:?}"
    );
    for peer in &status.peers {
        let PeerText { machine, age, ghosts, unacknowledged_bytes } = peer;
        let _ = writeln!(
            text,
            "  machine {machine}: {age} ticks old, {ghosts} ghosts, {unacknowledged_bytes} bytes not acknowledged"
        );
    }
    for machine in missing {
        let _ = writeln!(text, "  machine {machine} is missing");
    }
    for (why, count) in &status.refused {
        let _ = writeln!(text, "  refused {count} times: {why}");
    }
    Ok(text)
}

/// A report, as it is printed.
#[derive(Serialize)]
struct ReportText {
    tick: u64,
    age: u64,
    missing: Vec<u32>,
    lost: Vec<u32>,
    is_resync: bool,
    begun: Vec<PairText>,
    ended: Vec<(PairText, String)>,
    taken: Vec<PairText>,
    given: Vec<PairText>,
}

/// Machine, index and incarnation of two boxes.
type PairText = [[u32; 3]; 2];

fn pair_text(pair: &PairId) -> PairText {
    pair.map(|BoxId { machine, index, incarnation }| [machine.0, index, incarnation])
}

/// The bridge.
pub struct Bridge {
    settings: Settings,
    member: Member,
    link: ZenohLink,
    node: Node,
    begun: Instant,
    ticked_at: Duration,
    status_at: Duration,
    sent_bytes: u64,
    received_bytes: u64,
    refused: BTreeMap<String, u64>,
    is_failing: bool,
}

impl Bridge {
    /// Joins the scene, and the other bridges.
    ///
    /// # Errors
    /// [`BridgeError`].
    pub fn open(settings: Settings) -> Result<Self, BridgeError> {
        let member = Member::join(&settings.place)?;
        let link = ZenohLink::open(&settings.meeting, &settings.place.scene, settings.me.machine)?;
        let config = Config {
            me: settings.me,
            scene: hash(settings.place.scene.as_bytes()),
            terms: Terms { axis: settings.axis, lease_ms: settings.lease_ms },
            margin: settings.margin,
            at_end: member.at_end(),
            rebalance: settings.rebalance,
        };
        Ok(Self {
            node: Node::new(config, Duration::ZERO),
            settings,
            member,
            link,
            begun: Instant::now(),
            ticked_at: Duration::ZERO,
            status_at: Duration::ZERO,
            sent_bytes: 0,
            received_bytes: 0,
            refused: BTreeMap::new(),
            is_failing: false,
        })
    }

    /// One tick of the local scene. Where the daemon does not answer, the bridge goes on with what it knows.
    ///
    /// # Errors
    /// [`BridgeError`].
    pub fn tick(&mut self) -> Result<(), BridgeError> {
        let next = self.ticked_at + SHORTEST_TICK;
        std::thread::sleep(next.saturating_sub(self.begun.elapsed()));
        self.ticked_at = self.begun.elapsed();
        let changes = match self.member.tick() {
            Ok((changes, committed)) => {
                self.note_scene(committed.err());
                changes
            }
            Err(error) => {
                self.note_scene(Some(error));
                std::thread::sleep(PAUSE);
                Vec::new()
            }
        };
        let now = self.begun.elapsed();
        while let Some(bytes) = self.link.receive() {
            self.received_bytes += bytes.len() as u64;
            if let Err(refused) = self.node.receive(&bytes, now) {
                self.note_refused(refused);
            }
        }
        let output = self.node.tick(&changes, now)?;
        for (to, bytes) in output.messages {
            self.sent_bytes += bytes.len() as u64;
            self.link.send(to, bytes)?;
        }
        self.member.add(output.ghosts);
        if self.settings.prints_json {
            output.reports.iter().try_for_each(|report| self.print(report))?;
        }
        if now >= self.status_at {
            self.status_at = now + STATUS_INTERVAL;
            self.link.set_status(self.status()?);
        }
        Ok(())
    }

    /// Says the first of errors of the scene that follow each other.
    fn note_scene(&mut self, error: Option<pairmask::Error>) {
        let was_failing = std::mem::replace(&mut self.is_failing, error.is_some());
        if let Some(error) = error.filter(|_| !was_failing) {
            log::warn!("scene '{}': {error}", self.settings.place.scene);
        }
    }

    fn note_refused(&mut self, refused: Refused) {
        let why = refused.to_string();
        let count = self.refused.entry(why).or_default();
        *count += 1;
        if *count == 1 {
            log::warn!("refused: {refused}");
        }
    }

    fn print(&self, report: &Report) -> Result<(), BridgeError> {
        let Report { tick, begun, ended, taken, given, lost, is_resync } = report;
        if begun.len() + ended.len() + taken.len() + given.len() + lost.len() == 0 && !is_resync {
            return Ok(());
        }
        let all = |pairs: &[PairId]| pairs.iter().map(pair_text).collect();
        let missing = self.node.status().missing;
        let text = ReportText {
            tick: *tick,
            age: self.node.tick_number().saturating_sub(*tick),
            missing: missing.iter().map(|machine| machine.0).collect(),
            lost: lost.iter().map(|peer| peer.machine.0).collect(),
            is_resync: *is_resync,
            begun: all(begun),
            ended: ended.iter().map(|(pair, why)| (pair_text(pair), format!("{why:?}"))).collect(),
            taken: all(taken),
            given: all(given),
        };
        let mut out = std::io::stdout().lock();
        serde_json::to_writer(&mut out, &text)?;
        Ok(writeln!(out)?)
    }

    fn status(&self) -> Result<String, BridgeError> {
        let status = self.node.status();
        let peer = |peer: &crate::node::PeerStatus| PeerText {
            machine: peer.peer.machine.0,
            age: peer.age,
            ghosts: peer.ghosts,
            unacknowledged_bytes: peer.kept_bytes,
        };
        let text = StatusText {
            machine: self.settings.me.machine.0,
            tick: status.tick,
            report_age: status.tick.saturating_sub(status.evaluated),
            view: status.version.counter,
            boxes: status.boxes,
            ghosts: status.ghosts,
            pairs: status.pairs,
            missing: status.missing.iter().map(|machine| machine.0).collect(),
            sent_bytes: self.sent_bytes,
            received_bytes: self.received_bytes,
            dropped: self.link.dropped(),
            refused: self.refused.clone(),
            peers: status.peers.iter().map(peer).collect(),
            cuts: status.cuts,
        };
        Ok(serde_json::to_string(&text)?)
    }
}

/// FNV-1a, the same in every build.
fn hash(bytes: &[u8]) -> u64 {
    let mix = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, mix)
}
