//! Bridges beside one big scene, tick by tick.

use std::collections::BTreeSet;
use std::time::Duration;

use crate::simulation::{Crowd, LEASE_STEPS, Network, Played, Simulation};
use pairmask_bridge::ids::PairId;
use pairmask_core::scene::shared::AtEnd;

fn crowd(machines: usize, boxes: u32, length: f32) -> Crowd {
    let boxes = vec![boxes / machines as u32; machines];
    Crowd { length, width: 20.0, speed: 0.4, boxes, seed: 42, ..Crowd::default() }
}

fn bad_network() -> Network {
    let ms = Duration::from_millis;
    Network { delay: ms(20), jitter: ms(40), loss: 0.05, doubled: 0.1 }
}

/// What was seen of ticks that were right.
#[derive(Debug, Default)]
struct Seen {
    ticks: usize,
    pairs: usize,
    handed: usize,
}

/// Checks ticks, each beside the one before.
#[derive(Default)]
struct Checker {
    /// Later ticks are checked.
    from: u64,
    before: Option<(u64, BTreeSet<PairId>)>,
    seen: Seen,
}

impl Checker {
    /// Of the ticks that none has begun yet.
    fn from_now(simulation: &Simulation) -> Self {
        let ticks = simulation.statuses().into_iter().flatten().map(|status| status.tick);
        Self { from: ticks.max().unwrap_or(0), ..Self::default() }
    }

    fn check(&mut self, (crowd, part): (&Crowd, &[u32]), played: Vec<Played>) {
        for played in played.into_iter().filter(|played| played.tick > self.from) {
            let now = played.check(crowd, part).expect("the pairs of one big scene");
            if let Some((_, before)) =
                self.before.as_ref().filter(|(tick, _)| tick + 1 == played.tick)
            {
                self.seen.handed += played.check_events(before, &now).expect("each event once");
                self.seen.ticks += 1;
            }
            self.seen.pairs += now.len();
            self.before = Some((played.tick, now));
        }
    }

    fn run(&mut self, simulation: &mut Simulation, steps: u64) {
        for _ in 0..steps {
            simulation.run_step();
            let played = simulation.play();
            self.check((&simulation.crowd, &simulation.part), played);
        }
    }
}

/// Runs settled bridges.
fn run_settled(simulation: &mut Simulation, steps: u64) -> Seen {
    simulation.settle(3 * LEASE_STEPS);
    let mut checker = Checker::from_now(simulation);
    checker.run(simulation, steps);
    checker.seen
}

#[test]
fn pairs_of_all_bridges_are_those_of_one_scene() {
    for machines in [1, 2, 4, 8] {
        let mut simulation =
            Simulation::new(crowd(machines, 4_000, 100.0), Network::default(), 1.0, 9);
        let seen = run_settled(&mut simulation, 100);
        assert!(seen.ticks >= 90, "{seen:?}");
        assert!(machines == 1 || seen.pairs > 10_000 && seen.handed > 60, "{machines}: {seen:?}");
        let ghosts = simulation.check_ghosts(0.9);
        assert_eq!(ghosts > 0, machines > 1);
    }
}

#[test]
fn boxes_that_leap_and_change_in_every_way_are_pairs_of_one_scene() {
    for (machines, margin) in [(2, 0.0), (3, 0.5), (5, 10.0)] {
        let crowd = Crowd { is_restless: true, ..crowd(machines, 2_000, 60.0) };
        let mut simulation = Simulation::new(crowd, bad_network(), margin, 77);
        let seen = run_settled(&mut simulation, 200);
        assert!(seen.ticks >= 150 && seen.pairs > 10_000 && seen.handed > 50, "{seen:?}");
        simulation.check_ghosts(0.0);
    }
}

#[test]
fn what_a_network_does_changes_nothing_but_the_age() {
    let of = |network, seed| {
        let machines = 2 + seed as usize % 3;
        let crowd = Crowd { seed, ..crowd(machines, 300, 20.0) };
        let mut simulation = Simulation::new(crowd, Network::default(), 1.0, seed);
        simulation.settle(3 * LEASE_STEPS);
        simulation.run(20);
        let from = simulation.step;
        simulation.network = network;
        simulation.run(100);
        simulation.network = Network::default();
        simulation.run(60);
        let until = from + 100;
        let reports = |log: &Vec<_>| -> Vec<_> {
            let all = log
                .iter()
                .filter(|r: &&pairmask_bridge::node::Report| r.tick > from && r.tick <= until);
            all.cloned().collect()
        };
        simulation.log.iter().map(reports).collect::<Vec<_>>()
    };
    for seed in 1..=100 {
        let perfect = of(Network::default(), seed);
        assert!(perfect.iter().all(|reports| reports.len() == 100));
        assert!(perfect.iter().flatten().any(|report| !report.taken.is_empty()));
        assert!(perfect == of(bad_network(), seed), "{seed}: the network shows in reports");
    }
}

#[test]
fn a_checker_sees_a_pair_that_is_missing_and_one_that_is_reported_twice() {
    let mut simulation = Simulation::new(crowd(2, 2_000, 60.0), Network::default(), 1.0, 9);
    simulation.settle(3 * LEASE_STEPS);
    simulation.play();
    simulation.run(1);
    let mut played = simulation.play().pop().expect("a tick");
    let right = played.check(&simulation.crowd, &simulation.part).expect("right");
    let pair = *right.first().expect("a pair");
    assert!(played.check_events(&BTreeSet::new(), &right).is_err());
    for held in played.held.iter_mut().flatten() {
        held.insert(pair);
    }
    assert!(
        played
            .check(&simulation.crowd, &simulation.part)
            .is_err_and(|error| error.contains("twice"))
    );
    for held in played.held.iter_mut().flatten() {
        held.remove(&pair);
    }
    assert!(
        played
            .check(&simulation.crowd, &simulation.part)
            .is_err_and(|error| error.contains("missing"))
    );
}

#[test]
fn slabs_that_follow_density_move_no_pair() {
    // All begin in one half of the hall, and walk to the other end and back.
    let crowd = Crowd { drift: 0.5, crowded: 0.5, ..crowd(4, 3_000, 100.0) };
    let simulation = Simulation::new(crowd, bad_network(), 1.0, 5);
    let mut simulation = simulation.with_rebalance(Duration::from_millis(200));
    simulation.settle(4 * LEASE_STEPS);
    let mut checker = Checker::from_now(&simulation);
    let first = simulation.statuses()[0].clone().expect("it runs").version;
    checker.run(&mut simulation, 400);
    let last = simulation.statuses()[0].clone().expect("it runs").version;
    assert!(checker.seen.ticks > 300 && checker.seen.handed > 100, "{:?}", checker.seen);
    assert!(last.counter >= first.counter + 2, "{first:?} {last:?}");
}

/// Bridges on a network that loses one message in a hundred, of 20 ms delay.
fn faulty(machines: usize, seed: u64) -> Simulation {
    let ms = Duration::from_millis;
    let network = Network { delay: ms(20), jitter: ms(8), loss: 0.01, doubled: 0.01 };
    let crowd = Crowd { seed, ..crowd(machines, 300, 60.0) };
    let mut simulation = Simulation::new(crowd, network, 1.0, seed);
    simulation.settle(3 * LEASE_STEPS);
    simulation.run(20);
    simulation
}

/// After a fault: all is right within two leases, and nothing is left of it. Returns how many pairs were right.
fn converges(simulation: &mut Simulation) -> usize {
    simulation.settle(2 * LEASE_STEPS);
    simulation.play();
    let mut checker = Checker::from_now(simulation);
    checker.run(simulation, 25);
    assert!(checker.seen.ticks > 8, "{:?}", checker.seen);
    // A ghost may be some ticks late: a loss, and a walk meanwhile.
    simulation.check_ghosts(6.0);
    for status in simulation.statuses().into_iter().flatten() {
        for peer in &status.peers {
            assert!(peer.kept_bytes < 20_000 && peer.age < 20, "{status:?}");
        }
    }
    checker.seen.pairs
}

#[test]
fn a_network_that_is_cut_for_five_seconds_heals_to_the_same_set() {
    let mut pairs = 0;
    for seed in 1..=100 {
        let machines = 2 + seed as usize % 4;
        let mut simulation = faulty(machines, seed);
        // At least one on each side.
        let side = |machine: usize| {
            u32::from(machine == 0 || seed >> machine & 1 == 1 && machine + 1 < machines)
        };
        simulation.part = (0..machines).map(side).collect();
        simulation.run(2 * LEASE_STEPS);
        pairs += converges(&mut simulation);
        simulation.run(5 * LEASE_STEPS - 2 * LEASE_STEPS - 25);
        simulation.part = vec![0; machines];
        pairs += converges(&mut simulation);
        assert!(simulation.statuses().iter().flatten().all(|status| status.missing.is_empty()));
    }
    assert!(pairs > 10_000, "{pairs}");
}

#[test]
fn any_bridge_may_be_killed() {
    let mut pairs = 0;
    for seed in 1..=100 {
        let machines = 2 + seed as usize % 4;
        let killed = seed as usize / 4 % machines;
        let mut simulation = faulty(machines, seed);
        simulation.kill(killed);
        if seed % 3 > 0 {
            // Long after it was missed, or at once.
            let pause = if seed % 3 == 1 { 3 * LEASE_STEPS } else { 3 };
            simulation.run(pause);
            if seed % 3 == 1 {
                pairs += converges(&mut simulation);
                let mut all = simulation.statuses().into_iter().flatten();
                assert!(all.all(|status| status.missing.iter().any(|m| m.0 as usize == killed)));
            }
            simulation.start(killed);
        }
        pairs += converges(&mut simulation);
    }
    assert!(pairs > 10_000, "{pairs}");
}

#[test]
fn a_steward_that_dies_while_slabs_change_leaves_no_pair_reported_twice() {
    let (mut changing, mut alike) = (0, 0);
    for seed in 1..=300 {
        let ms = Duration::from_millis;
        let network = Network { delay: ms(20), jitter: ms(8), loss: 0.05, doubled: 0.01 };
        let machines = 3 + seed as usize % 3;
        let crowd = Crowd { drift: 0.5, seed, ..crowd(machines, 300, 60.0) };
        let mut simulation = Simulation::new(crowd, network, 1.0, seed);
        simulation = simulation.with_rebalance(ms(200));
        simulation.settle(4 * LEASE_STEPS);
        simulation.run(20 + seed % 40);
        // What it says last reaches some of the others.
        simulation.network.loss = 0.6;
        simulation.run(4);
        simulation.network = network;
        let versions = |simulation: &Simulation| -> BTreeSet<_> {
            simulation.statuses().into_iter().flatten().map(|status| status.version).collect()
        };
        simulation.play();
        simulation.kill(0);
        let before = versions(&simulation);
        for _ in 0..2 * LEASE_STEPS {
            simulation.run_step();
            for mut played in simulation.play() {
                // What each has received of the lost one may differ until all report the loss. Who lacks some of it has no
                // report of a tick.
                for held in played.held.iter_mut().flatten() {
                    held.retain(|pair| pair.iter().all(|id| id.machine.0 > 0));
                }
                if played.reports.len() == machines - 1 {
                    played.check_sides().expect("each pair at one side");
                    alike += 1;
                }
            }
            changing += usize::from(versions(&simulation) != before);
        }
        simulation.settle(LEASE_STEPS);
        simulation.play();
        let mut checker = Checker::from_now(&simulation);
        checker.run(&mut simulation, 50);
        assert!(checker.seen.ticks > 8 && checker.seen.pairs > 0, "{:?}", checker.seen);
    }
    assert!(
        changing > 0 && alike > 5_000,
        "{changing} steps after a change of slabs, {alike} ticks"
    );
}

#[test]
fn a_steward_that_was_not_received_for_a_while_leads_again() {
    for seed in 1..=100 {
        let machines = 2 + seed as usize % 4;
        let mut simulation = faulty(machines, seed);
        // After this its view is another one's proposal.
        simulation.kill(0);
        simulation.settle(3 * LEASE_STEPS);
        simulation.start(0);
        simulation.settle(3 * LEASE_STEPS);
        simulation.unheard = Some(0);
        simulation.run(LEASE_STEPS + 20 + seed % LEASE_STEPS);
        simulation.unheard = None;
        simulation.settle(3 * LEASE_STEPS);
        assert!(converges(&mut simulation) > 0);
    }
}

#[test]
fn two_that_lack_a_link_for_a_while_are_in_one_view_again() {
    for seed in 1..=100 {
        let machines = 3 + seed as usize % 3;
        let mut simulation = faulty(machines, seed);
        let one = seed as usize / 3 % machines;
        let other = (one + 1 + seed as usize % (machines - 1)) % machines;
        simulation.unlinked = Some([one, other]);
        simulation.run(5 * LEASE_STEPS + 3 * seed);
        simulation.unlinked = None;
        // One of the two may be about to be left out once more.
        simulation.run(LEASE_STEPS);
        assert!(converges(&mut simulation) > 0);
    }
}

#[test]
fn messages_that_are_not_understood_are_refused_and_change_nothing() {
    let mut simulation = Simulation::new(crowd(3, 600, 30.0), bad_network(), 1.0, 11);
    simulation.corrupt_one_in = Some(10);
    let seen = run_settled(&mut simulation, 150);
    assert!(seen.ticks > 80 && simulation.refused > 100, "{seen:?} {}", simulation.refused);
}

#[test]
fn ghosts_of_a_lost_machine_stay_where_the_scene_keeps_them() {
    for at_end in [AtEnd::Remove, AtEnd::Keep] {
        let crowd = crowd(3, 300, 30.0);
        let mut simulation = Simulation::new(crowd, Network::default(), 2.0, 6);
        simulation.at_end = at_end;
        (0..3).for_each(|machine| simulation.start(machine));
        simulation.settle(3 * LEASE_STEPS);
        simulation.run(20);
        simulation.kill(1);
        simulation.run(2 * LEASE_STEPS);
        assert!(simulation.is_settled());
        let of_killed = |simulation: &Simulation| {
            let ghosts = simulation.ghosts.iter().flat_map(|ghosts| ghosts.keys());
            ghosts.filter(|(machine, _)| machine.0 == 1).count()
        };
        assert_eq!(of_killed(&simulation) > 10, at_end == AtEnd::Keep);
        // Pairs with them are no longer reported in either case.
        simulation.start(1);
        assert!(converges(&mut simulation) > 0);
        assert!(of_killed(&simulation) > 10);
    }
}
