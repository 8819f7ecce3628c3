//! A hundred thousand walkers and a hundred thousand border crossings, beside one big scene. Minutes: for the night.

use std::collections::BTreeSet;

use crate::simulation::{Crowd, LEASE_STEPS, Network, Simulation};
use pairmask_bridge::ids::PairId;

const BOXES: u32 = 100_000;
/// Indices whose box has another slab than a step before.
const CROSSINGS: u64 = 100_000;

fn crossings(simulation: &Simulation, cuts: &[f32]) -> u64 {
    let (crowd, step) = (&simulation.crowd, simulation.step);
    let slab = |machine, index, step| {
        let (_, state) = crowd.at(machine, index, step)?;
        Some(cuts.partition_point(|cut| *cut <= state.aabb.min[0]))
    };
    let of = |machine: usize| {
        let crosses = |index: &u32| slab(machine, *index, step) != slab(machine, *index, step - 1);
        (0..crowd.boxes[machine]).filter(crosses).count() as u64
    };
    (0..crowd.boxes.len()).map(of).sum()
}

fn walk(machines: usize) {
    let boxes = vec![BOXES / machines as u32; machines];
    // Five boxes on ten square units, which walk together: pairs go on across borders.
    let length = 100.0 * machines as f32;
    let width = 2.0 * BOXES as f32 / length;
    let crowd = Crowd { length, width, speed: 0.2, drift: 0.5, boxes, seed: 1, ..Crowd::default() };
    let mut simulation = Simulation::new(crowd, Network::default(), 2.0, 1);
    simulation.settle(3 * LEASE_STEPS);
    let from = simulation.step;
    let (mut before, mut crossed) = (None::<(u64, BTreeSet<PairId>)>, 0);
    let (mut handed, mut pairs, mut ticks) = (0, 0, 0);
    while crossed < CROSSINGS {
        simulation.run_step();
        let cuts = simulation.statuses().remove(0).expect("it runs").cuts;
        assert_eq!(cuts.len(), machines - 1);
        crossed += crossings(&simulation, &cuts);
        for played in simulation.play().into_iter().filter(|played| played.tick > from) {
            let now = played.check(&simulation.crowd, &simulation.part).expect("one big scene");
            if let Some((_, before)) = before.filter(|(tick, _)| tick + 1 == played.tick) {
                handed += played.check_events(&before, &now).expect("each event once");
                ticks += 1;
            }
            pairs += now.len();
            before = Some((played.tick, now));
        }
    }
    println!(
        "{machines} bridges: {crossed} crossings, {pairs} pairs in {ticks} ticks, {handed} given and taken"
    );
    assert!(pairs > 100_000 && handed > 1_000 && ticks > 30, "{pairs} {handed} {ticks}");
}

#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn a_hundred_thousand_crossings_of_two_bridges() {
    walk(2);
}

#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn a_hundred_thousand_crossings_of_four_bridges() {
    walk(4);
}

#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn a_hundred_thousand_crossings_of_eight_bridges() {
    walk(8);
}
