//! What a scene over several machines costs, in closed form: bytes a tick, ghosts, ages, pairs that are seen late.
//!
//! Machines stand side by side along the axis, each with its own boxes, evenly spread over its slab and a little beyond it.
//! A simulation is held to it within a fifth; `examples/two_machines/run` prints it beside what it measures.

/// Bytes of a batch beside its edits: head, receiver, versions, ticks, counts.
const BATCH_BYTES: f64 = 65.0;
/// Bytes of a beat: head, terms, spread.
const BEAT_BYTES: f64 = 129.0;
/// Beats in a second where a lease is one: to each of the others.
const BEATS_A_LEASE: f64 = 8.0;
/// Bytes of a box that moved, without its index.
const MOVED_BYTES: f64 = 24.0;
/// Bytes of a box that comes into sight, with what it was the tick before, and of one that goes out of it.
const ENTERED_BYTES: f64 = 52.0;
const LEFT_BYTES: f64 = 26.0;
/// Bytes that Ethernet, IP, TCP and Zenoh add to a message, and to each further packet of a long one: frame 38, IP 20, TCP 32,
/// and some 20 of Zenoh.
const PACKET_BYTES: f64 = 110.0;
/// Bytes of a message in a packet.
const PACKET_ROOM: f64 = 1_400.0;

/// A scene, and the network between its machines.
#[derive(Clone, Copy, Debug)]
pub struct Scenario {
    /// Machines.
    pub machines: f64,
    /// Boxes of each.
    pub boxes: f64,
    /// Width of a slab.
    pub slab: f64,
    /// How far boxes walk beyond their machine's slab.
    pub beyond: f64,
    /// How long a box is along the axis.
    pub size: f64,
    /// The margin of ghosts.
    pub margin: f64,
    /// Mean of the speed along the axis, whichever way, in units a tick.
    pub speed: f64,
    /// The share of boxes that move in a tick.
    pub moving: f64,
    /// A tick, s.
    pub tick: f64,
    /// A lease, s.
    pub lease: f64,
    /// One way from machine to machine, s.
    pub latency: f64,
    /// The share of messages that is lost.
    pub loss: f64,
    /// Pairs between machines, in all of the scene.
    pub pairs: f64,
    /// Those that begin in a tick. As many end.
    pub begins: f64,
    /// What a machine's link carries, bytes a second.
    pub bandwidth: f64,
}

/// What follows.
#[derive(Clone, Copy, Debug)]
pub struct Prediction {
    /// Boxes that a machine publishes: ghosts elsewhere, those of inner machines.
    pub ghosts: f64,
    /// Bytes of messages that a machine sends in a tick, of inner machines.
    pub message_bytes: f64,
    /// Bytes of messages of all machines in a tick.
    pub all_message_bytes: f64,
    /// Bytes on a machine's link in a tick, with the heads of packets.
    pub link_bytes: f64,
    /// The share of the link that this fills.
    pub link_share: f64,
    /// Messages that a machine sends in a second, and receives.
    pub messages_a_second: f64,
    /// The mean age of a ghost, ticks.
    pub ghost_age: f64,
    /// The mean age of a report of pairs between machines, ticks.
    pub report_age: f64,
    /// Pairs between machines that overlap now and that nobody reports yet: those that began within the age of reports.
    pub late_pairs: f64,
}

impl Scenario {
    /// What the scene costs.
    pub fn predict(&self) -> Prediction {
        let others = self.machines - 1.0;
        let density = self.boxes / (self.slab + 2.0 * self.beyond);
        // At a border, one machine's: as far as the border, and beyond it.
        let published = density * (self.beyond + self.margin + self.size);
        // As many come into sight as go out of it: half of those that pass a place walk each way.
        let passing = density * self.speed / 2.0;
        // Indices are written as distances: a second byte where 127 boxes in a row are not published.
        let borders = 2.0 * others / self.machines;
        let share = (published * self.moving / self.boxes).min(1.0);
        let index_bytes = 1.0 + (1.0 - share).powi(127);
        let moved = published * self.moving * (MOVED_BYTES + index_bytes);
        let passed = passing * (ENTERED_BYTES - MOVED_BYTES + LEFT_BYTES + index_bytes);
        let again = 1.0 / (1.0 - self.loss);
        let beats = BEATS_A_LEASE * self.tick / self.lease;
        let heads = others * (BATCH_BYTES * again + BEAT_BYTES * beats);
        let of_borders = |borders: f64| borders * (moved + passed) * again + heads;
        let packets_of_border = ((moved + passed) / PACKET_ROOM).floor();
        let link = |borders: f64| {
            of_borders(borders)
                + PACKET_BYTES * (others * (1.0 + beats) + borders * packets_of_border)
        };
        let inner = if self.machines > 2.0 { 2.0 } else { others.min(1.0) };
        // A message waits for the next tick of its receiver: half of one on average, and all of it where both have a clock.
        let ticks = (self.latency / self.tick).ceil().max(1.0);
        // One that is lost is sent again once the next one has been acknowledged, a round trip later.
        let round_trip = 2.0 * ticks + 1.0;
        let ghost_age = ticks + self.loss * round_trip;
        let none_lost = (1.0 - self.loss).powf(others * round_trip);
        let report_age = ticks + (1.0 - none_lost) * round_trip / 2.0;
        let all = self.machines * of_borders(borders);
        Prediction {
            ghosts: inner * published,
            message_bytes: of_borders(inner),
            all_message_bytes: all,
            link_bytes: link(inner),
            link_share: link(inner) / self.tick / self.bandwidth,
            messages_a_second: others * (1.0 + beats) / self.tick,
            ghost_age,
            report_age,
            // Of those that began within the age, some have ended.
            late_pairs: self.pairs * (1.0 - (1.0 - self.begins / self.pairs).powf(report_age)),
        }
    }
}
