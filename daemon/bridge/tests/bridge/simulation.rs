//! Bridges on a network that delays, loses, doubles and reorders messages, is cut and healed, and whose bridges are killed
//! and started again; all by one seed. Beside it, the oracle: one big scene of all boxes, at the same ticks. One file, since the
//! oracle reads the crowd that the network carries.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use pairmask_bridge::ids::{BoxId, MachineId, PairId, Peer, pair_of};
use pairmask_bridge::node::{Config, Destination, Node, Report};
use pairmask_bridge::protocol::Terms;
use pairmask_bridge::state::BoxState;
use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterData, Owner, World};
use pairmask_core::scene::shared::AtEnd;

pub const TICK: Duration = Duration::from_millis(16);
pub const LEASE_MS: u32 = 1_000;
/// Steps of a lease.
pub const LEASE_STEPS: u64 = LEASE_MS as u64 / 16 + 1;

/// xorshift64*.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// From 0 to below 1.
    pub fn part(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// What the network does to messages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Network {
    pub delay: Duration,
    /// More delay, up to so much: what overtakes each other.
    pub jitter: Duration,
    pub loss: f64,
    pub doubled: f64,
}

/// A crowd that walks to and fro in a long hall, each at a speed of its own. Who is where follows from the step.
#[derive(Clone, Debug, Default)]
pub struct Crowd {
    pub length: f32,
    pub width: f32,
    pub speed: f32,
    /// How far all walk in a step, beside their own speeds.
    pub drift: f32,
    /// The share of the hall in which they begin; 0 for all of it.
    pub crowded: f32,
    /// How far boxes walk beyond their machine's part; `None` for as far as the hall.
    pub beyond: Option<f32>,
    /// Of each machine's boxes, so many walk within the middle fifth of its part.
    pub interior: u32,
    /// Boxes of each machine.
    pub boxes: Vec<u32>,
    /// Whether boxes also leap, are removed and set anew, disabled, and change their worlds and owners.
    pub is_restless: bool,
    pub seed: u64,
}

fn to_and_fro(x: f32, length: f32) -> f32 {
    let x = x.rem_euclid(2.0 * length);
    if x > length { 2.0 * length - x } else { x }
}

/// Steps between what a restless box does.
const RESTLESS: u64 = 20;

impl Crowd {
    pub fn id(machine: usize, index: u32, incarnation: u32) -> BoxId {
        BoxId { machine: MachineId(machine as u32), index, incarnation }
    }

    fn random(&self, machine: usize, index: u32, more: u64) -> Random {
        let salt = (machine as u64) << 40 ^ u64::from(index) << 8 ^ more << 48;
        let mut random = Random(self.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ salt | 1);
        for _ in 0..3 {
            random.next();
        }
        random
    }

    /// The box of an index at a step.
    pub fn at(&self, machine: usize, index: u32, step: u64) -> Option<(u32, BoxState)> {
        let mut random = self.random(machine, index, 0);
        let machines = self.boxes.len() as f64;
        // It begins in its machine's part.
        let share = random.part();
        let x = ((machine as f64 + share) / machines) as f32 * self.length;
        let x = if self.crowded > 0.0 { x * self.crowded } else { x };
        let y = random.part() as f32 * self.width;
        let speed = self.speed * (random.part() as f32 * 2.0 - 1.0);
        let side = self.speed * (random.part() as f32 - 0.5);
        let (mut x, y) = (
            x + (speed + self.drift) * step as f32,
            to_and_fro(y + side * step as f32, self.width),
        );
        let (mut incarnation, mut state) = (0, BoxState::from(Aabb::EMPTY));
        if self.is_restless {
            let turn = (step + random.next() % RESTLESS) / RESTLESS;
            incarnation = turn as u32 / 4;
            let mut random = self.random(machine, index, turn);
            match random.next() % 9 {
                0 => return None,
                1 => state.is_enabled = false,
                2 => state.filter_data = FilterData::default().with_world(World(1)),
                3 => state.filter_data = FilterData::default().with_owner(Owner(5)),
                4 => state.filter_data = FilterData::default().with_static(true),
                5 => state.user_data = random.next(),
                6 => state.filter = Filter::new(random.next() % 4, 2).with_group(-1),
                _ => x += random.part() as f32 * self.length,
            }
        }
        let part = self.length / machines as f32;
        let x = match self.beyond {
            _ if index < self.interior => (machine as f32 + 0.4) * part + to_and_fro(x, 0.2 * part),
            Some(beyond) => {
                let (start, length) = (machine as f32 * part - beyond, part + 2.0 * beyond);
                start + to_and_fro(share as f32 * length + speed * step as f32, length)
            }
            None => to_and_fro(x, self.length),
        };
        state.aabb = Aabb::new([x, y, 0.0], [x + 0.5, y + 0.5, 1.8]);
        Some((incarnation, state))
    }

    /// All pairs of boxes of different machines, by sweep and prune, each machine at a step of its own; `None` where it is not there.
    pub fn pairs(&self, steps: &[Option<u64>]) -> BTreeSet<PairId> {
        let mut pairs = BTreeSet::new();
        let mut boxes = Vec::new();
        for (machine, step) in steps.iter().enumerate() {
            let Some(step) = step else { continue };
            for index in 0..self.boxes[machine] {
                if let Some((incarnation, state)) = self.at(machine, index, *step) {
                    boxes.push((Self::id(machine, index, incarnation), state));
                }
            }
        }
        boxes.sort_unstable_by(|(_, a), (_, b)| a.aabb.min[0].total_cmp(&b.aabb.min[0]));
        for (at, (a, a_state)) in boxes.iter().enumerate() {
            let mut near = boxes[at + 1..].iter();
            while let Some((b, b_state)) = near.next()
                && b_state.aabb.min[0] <= a_state.aabb.max[0]
            {
                if a.machine != b.machine && a_state.meets(b_state) {
                    pairs.insert(pair_of(*a, *b));
                }
            }
        }
        pairs
    }
}

struct Running {
    node: Node,
    /// The step of each tick.
    steps: BTreeMap<u64, u64>,
    reports: Vec<Report>,
    held: BTreeSet<PairId>,
    evaluated: Option<u64>,
}

pub struct Simulation {
    pub crowd: Crowd,
    pub network: Network,
    pub random: Random,
    pub step: u64,
    incarnation: u64,
    nodes: Vec<Option<Running>>,
    /// By arrival and a number.
    on_the_way: BTreeMap<(Duration, u64), (usize, usize, Vec<u8>)>,
    sent: u64,
    /// Machines that reach each other have the same number.
    pub part: Vec<u32>,
    /// Two machines without a link.
    pub unlinked: Option<[usize; 2]>,
    /// A machine whose messages reach nobody.
    pub unheard: Option<usize>,
    margin: f32,
    rebalance: Option<Duration>,
    /// What becomes of a lost machine's ghosts, of bridges that start from now on.
    pub at_end: AtEnd,
    /// Bytes that each machine sent.
    pub bytes: Vec<u64>,
    pub messages: u64,
    /// Of all messages, one in so many has a byte turned over.
    pub corrupt_one_in: Option<u64>,
    pub refused: u64,
    /// Reports by machine, in their order.
    pub log: Vec<Vec<Report>>,
    pub ghosts: Vec<BTreeMap<(MachineId, u32), (u32, BoxState)>>,
}

impl Simulation {
    pub fn new(crowd: Crowd, network: Network, margin: f32, seed: u64) -> Self {
        let machines = crowd.boxes.len();
        let mut simulation = Self {
            crowd,
            network,
            random: Random(seed | 1),
            step: 0,
            incarnation: 0,
            nodes: (0..machines).map(|_| None).collect(),
            on_the_way: BTreeMap::new(),
            sent: 0,
            part: vec![0; machines],
            unlinked: None,
            unheard: None,
            margin,
            rebalance: None,
            at_end: AtEnd::Remove,
            bytes: vec![0; machines],
            messages: 0,
            corrupt_one_in: None,
            refused: 0,
            log: vec![Vec::new(); machines],
            ghosts: vec![BTreeMap::new(); machines],
        };
        (0..machines).for_each(|machine| simulation.start(machine));
        simulation
    }

    pub fn with_rebalance(mut self, every: Duration) -> Self {
        self.rebalance = Some(every);
        for machine in 0..self.nodes.len() {
            self.start(machine);
        }
        self
    }

    pub fn machines(&self) -> usize {
        self.nodes.len()
    }

    pub fn now(&self) -> Duration {
        TICK * self.step as u32
    }

    pub fn node(&self, machine: usize) -> Option<&Node> {
        self.nodes[machine].as_ref().map(|running| &running.node)
    }

    /// Starts a bridge, anew if there was one.
    pub fn start(&mut self, machine: usize) {
        self.incarnation += 1;
        let me = Peer { machine: MachineId(machine as u32), incarnation: self.incarnation };
        let config = Config {
            me,
            scene: 7,
            terms: Terms { axis: 0, lease_ms: LEASE_MS },
            margin: self.margin,
            at_end: self.at_end,
            rebalance: self.rebalance,
        };
        let node = Node::new(config, self.now());
        let (steps, reports, held) = (BTreeMap::new(), Vec::new(), BTreeSet::new());
        self.ghosts[machine].clear();
        self.nodes[machine] = Some(Running { node, steps, reports, held, evaluated: None });
    }

    pub fn kill(&mut self, machine: usize) {
        self.nodes[machine] = None;
        self.ghosts[machine].clear();
    }

    fn post(&mut self, from: usize, to: usize, bytes: &[u8]) {
        self.bytes[from] += bytes.len() as u64;
        self.messages += 1;
        let is_unlinked = self.unlinked.is_some_and(|of| of.contains(&from) && of.contains(&to));
        if is_unlinked
            || self.unheard == Some(from)
            || self.part[from] != self.part[to]
            || self.random.part() < self.network.loss
        {
            return;
        }
        let copies = if self.random.part() < self.network.doubled { 2 } else { 1 };
        for _ in 0..copies {
            self.sent += 1;
            let more = self.network.jitter.mul_f64(self.random.part());
            let at = self.now() + self.network.delay + more;
            let mut bytes = bytes.to_vec();
            if self.corrupt_one_in.is_some_and(|n| self.random.next().is_multiple_of(n)) {
                let at = self.random.next() as usize % bytes.len();
                bytes[at] ^= 1 << (self.random.next() % 8);
                // What is turned over in transit is found out by the transport's checksum, unless it is the head's
                // turn: a wrong magic, version or kind.
                bytes[5] = 0xff;
            }
            self.on_the_way.insert((at, self.sent), (from, to, bytes));
        }
    }

    /// All that happens in a tick.
    pub fn run_step(&mut self) {
        self.step += 1;
        let now = self.now();
        while let Some(first) = self.on_the_way.first_entry() {
            if first.key().0 > now {
                break;
            }
            let (from, to, bytes) = first.remove();
            if self.part[from] != self.part[to] {
                continue;
            }
            if let Some(running) = &mut self.nodes[to] {
                self.refused += u64::from(running.node.receive(&bytes, now).is_err());
            }
        }
        for machine in 0..self.nodes.len() {
            let Some(running) = &mut self.nodes[machine] else { continue };
            let is_first = running.steps.is_empty();
            let change = |index: u32| {
                let now = self.crowd.at(machine, index, self.step);
                let was =
                    if is_first { None } else { self.crowd.at(machine, index, self.step - 1) };
                (now != was).then_some((index, now))
            };
            let changes: Vec<_> = (0..self.crowd.boxes[machine]).filter_map(change).collect();
            let output = running.node.tick(&changes, now).expect("few pairs");
            running.steps.insert(running.node.tick_number(), self.step);
            running.reports.extend(output.reports.iter().cloned());
            self.log[machine].extend(output.reports);
            for ghost in output.ghosts {
                let key = (ghost.machine, ghost.index);
                match ghost.state {
                    Some(local) => drop(self.ghosts[machine].insert(key, local)),
                    None => drop(self.ghosts[machine].remove(&key)),
                }
            }
            for (destination, bytes) in output.messages {
                match destination {
                    Destination::One(to) => self.post(machine, to.0 as usize, &bytes),
                    Destination::All => {
                        for to in (0..self.nodes.len()).filter(|to| *to != machine) {
                            self.post(machine, to, &bytes);
                        }
                    }
                }
            }
        }
    }

    pub fn run(&mut self, steps: u64) {
        (0..steps).for_each(|_| self.run_step());
    }

    /// Whether those that run, and reach each other, have one view of exactly themselves.
    pub fn is_settled(&self) -> bool {
        let of = |machine: usize| {
            let status = self.node(machine)?.status();
            let mut members: Vec<u32> = status.peers.iter().map(|p| p.peer.machine.0).collect();
            members.push(machine as u32);
            members.sort_unstable();
            Some((status.version, members))
        };
        (0..self.machines()).all(|machine| {
            let Some(own) = of(machine) else { return true };
            let there = |other: &usize| {
                self.part[*other] == self.part[machine] && self.nodes[*other].is_some()
            };
            let reached: Vec<usize> = (0..self.machines()).filter(there).collect();
            own.1.iter().map(|m| *m as usize).eq(reached.iter().copied())
                && reached.iter().all(|other| of(*other).as_ref() == Some(&own))
        })
    }

    /// Checks that the ghosts of each machine are boxes of others that it reaches, within a margin of what it owns as far
    /// as so many steps let them go, and that none of those well within is missing. Returns how many there are.
    pub fn check_ghosts(&self, slack: f32) -> usize {
        let mut count = 0;
        for machine in 0..self.machines() {
            let Some(node) = self.node(machine) else { continue };
            let (status, owned) = (node.status(), node.owned());
            let near = |state: &BoxState, by: f32| {
                state.is_there()
                    && state.aabb.min[0] - by <= owned.end
                    && state.aabb.max[0] + by >= owned.start
            };
            let members: BTreeSet<u32> = status.peers.iter().map(|p| p.peer.machine.0).collect();
            for ((of, _), (_, state)) in &self.ghosts[machine] {
                assert!(
                    members.contains(&of.0),
                    "{machine} has a ghost of {of:?}, who is not there"
                );
                assert!(near(state, self.margin), "{machine} has a ghost far away: {state:?}");
            }
            for other in (0..self.machines()).filter(|other| members.contains(&(*other as u32))) {
                for index in 0..self.crowd.boxes[other] {
                    let Some((_, state)) = self.crowd.at(other, index, self.step) else { continue };
                    let key = (MachineId(other as u32), index);
                    let has = self.ghosts[machine].contains_key(&key);
                    if !self.crowd.is_restless && near(&state, self.margin - slack) {
                        assert!(has, "{machine} lacks {key:?}");
                    }
                    count += usize::from(has);
                }
            }
        }
        count
    }

    /// Runs until all is settled. How many steps that took; panics after too many.
    pub fn settle(&mut self, most: u64) -> u64 {
        let begun = self.step;
        while !self.is_settled() {
            assert!(
                self.step - begun < most,
                "not settled after {most} steps: {:#?}",
                self.statuses()
            );
            self.run_step();
        }
        self.step - begun
    }

    pub fn statuses(&self) -> Vec<Option<pairmask_bridge::node::Status>> {
        (0..self.machines()).map(|machine| self.node(machine).map(Node::status)).collect()
    }

    /// What each machine's boxes are at a tick: the step at which they were set.
    fn steps_at(&self, tick: u64) -> Vec<Option<u64>> {
        let of = |running: &Option<Running>| {
            running.as_ref()?.steps.range(..=tick).next_back().map(|(_, step)| *step)
        };
        self.nodes.iter().map(of).collect()
    }

    /// Pairs between machines that overlap now, and that nobody reports yet.
    pub fn late_pairs(&self) -> usize {
        let now: Vec<_> = (0..self.machines()).map(|_| Some(self.step)).collect();
        let nodes = (0..self.machines()).filter_map(|machine| self.node(machine));
        let reported: BTreeSet<PairId> = nodes.flat_map(Node::pairs).copied().collect();
        self.crowd.pairs(&now).difference(&reported).count()
    }

    /// Plays the reports up to the last tick that all have evaluated. Returns the ticks, with what was reported in each.
    pub fn play(&mut self) -> Vec<Played> {
        let running = self.nodes.iter().flatten();
        let Some(until) = running.map(|r| r.node.status().evaluated).min() else {
            return Vec::new();
        };
        let mut by_tick: BTreeMap<u64, Played> = BTreeMap::new();
        for (machine, running) in self.nodes.iter_mut().enumerate() {
            let Some(running) = running else { continue };
            let (now, later): (Vec<_>, Vec<_>) =
                std::mem::take(&mut running.reports).into_iter().partition(|r| r.tick <= until);
            running.reports = later;
            for report in now {
                assert!(running.evaluated.is_none_or(|last| report.tick > last), "ticks rise");
                running.evaluated = Some(report.tick);
                by_tick.entry(report.tick).or_default().reports.push((machine, report));
            }
        }
        let mut played = Vec::new();
        for (tick, mut of) in by_tick {
            for (machine, report) in &of.reports {
                let Some(running) = &mut self.nodes[*machine] else { continue };
                let held = &mut running.held;
                for peer in &report.lost {
                    held.retain(|pair| pair.iter().all(|id| id.machine != peer.machine));
                }
                for pair in report.begun.iter().chain(&report.taken) {
                    assert!(
                        held.insert(*pair),
                        "{machine} at {tick}: {pair:?} is reported already"
                    );
                }
                for pair in report.ended.iter().map(|(pair, _)| pair).chain(&report.given) {
                    assert!(held.remove(pair), "{machine} at {tick}: {pair:?} was not reported");
                }
            }
            of.tick = tick;
            of.held = self.nodes.iter().map(|r| r.as_ref().map(|r| r.held.clone())).collect();
            of.steps = self.steps_at(tick);
            played.push(of);
        }
        played
    }
}

/// What was reported in a tick, and all that is reported after it.
#[derive(Default)]
pub struct Played {
    pub tick: u64,
    pub reports: Vec<(usize, Report)>,
    pub held: Vec<Option<BTreeSet<PairId>>>,
    pub steps: Vec<Option<u64>>,
}

impl Played {
    /// Checks that the pairs of all bridges are those of one big scene, each at one bridge. Machines in different parts of a
    /// network have a scene each.
    pub fn check(&self, crowd: &Crowd, part: &[u32]) -> Result<BTreeSet<PairId>, String> {
        let all = self.check_sides()?;
        let mut right = crowd.pairs(&self.steps);
        right.retain(|pair| {
            let [a, b] = pair.map(|id| part[id.machine.0 as usize]);
            a == b
        });
        if let Some(pair) = right.symmetric_difference(&all).next() {
            let is = if right.contains(pair) { "missing" } else { "wrong" };
            return Err(format!("tick {}: {pair:?} is {is}", self.tick));
        }
        Ok(all)
    }

    /// Checks that each pair has one side. Returns the pairs.
    pub fn check_sides(&self) -> Result<BTreeSet<PairId>, String> {
        let mut all = BTreeSet::new();
        match self.held.iter().flatten().flatten().find(|pair| !all.insert(**pair)) {
            Some(pair) => Err(format!("tick {}: {pair:?} is reported twice", self.tick)),
            None => Ok(all),
        }
    }

    /// Checks what was reported in a tick beside the pairs of the last one: each pair begins and ends once, at one bridge,
    /// and what one gives another one takes. Returns how many changed hands.
    pub fn check_events(
        &self,
        before: &BTreeSet<PairId>,
        now: &BTreeSet<PairId>,
    ) -> Result<usize, String> {
        let tick = self.tick;
        let collect = |f: fn(&Report) -> Vec<PairId>| -> Vec<PairId> {
            let mut all: Vec<PairId> = self.reports.iter().flat_map(|(_, r)| f(r)).collect();
            all.sort_unstable();
            all
        };
        let (given, taken) = (collect(|r| r.given.clone()), collect(|r| r.taken.clone()));
        if given != taken {
            let (gave, took) = (given.len(), taken.len());
            return Err(format!("tick {tick}: {gave} given, {took} taken, not the same ones"));
        }
        let begun = collect(|r| r.begun.clone());
        if !now.difference(before).eq(&begun) {
            return Err(format!("tick {tick}: {} begun, not the right ones", begun.len()));
        }
        let ended = collect(|r| r.ended.iter().map(|(pair, _)| *pair).collect());
        if !before.difference(now).eq(&ended) {
            return Err(format!("tick {tick}: {} ended, not the right ones", ended.len()));
        }
        Ok(given.len())
    }
}
