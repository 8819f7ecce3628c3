//! What crosses the network, beside the model; and how it does not grow with what is far from borders.

use std::time::Duration;

use crate::simulation::{Crowd, LEASE_MS, LEASE_STEPS, Network, Simulation, TICK};
use pairmask_bridge::model::{Prediction, Scenario};

const STEPS: u64 = 160;

/// What was measured, means over ticks.
#[derive(Clone, Copy, Debug, Default)]
struct Measured {
    message_bytes: f64,
    ghosts: f64,
    ghost_age: f64,
    report_age: f64,
    late_pairs: f64,
    begins: f64,
    pairs: f64,
}

fn measure(crowd: Crowd, network: Network, margin: f32) -> Measured {
    let machines = crowd.boxes.len();
    let mut simulation = Simulation::new(crowd, network, margin, 31);
    simulation.settle(4 * LEASE_STEPS);
    simulation.run(40);
    let before: u64 = simulation.bytes.iter().sum();
    simulation.log.iter_mut().for_each(Vec::clear);
    let mut measured = Measured::default();
    let mut add =
        |to: fn(&mut Measured) -> &mut f64, what: f64| *to(&mut measured) += what / STEPS as f64;
    for _ in 0..STEPS {
        simulation.run_step();
        let statuses: Vec<_> = simulation.statuses().into_iter().flatten().collect();
        let n = machines as f64;
        let peers = statuses.iter().flat_map(|status| &status.peers);
        let ages: f64 = peers.map(|peer| peer.age as f64).sum();
        add(|m| &mut m.ghost_age, ages / n / (n - 1.0));
        let ages: f64 = statuses.iter().map(|status| (status.tick - status.evaluated) as f64).sum();
        add(|m| &mut m.report_age, ages / n);
        add(|m| &mut m.ghosts, statuses.iter().map(|status| status.ghosts as f64).sum::<f64>());
        add(|m| &mut m.pairs, statuses.iter().map(|status| status.pairs as f64).sum());
        add(|m| &mut m.late_pairs, simulation.late_pairs() as f64);
    }
    let begins: usize = simulation.log.iter().flatten().map(|report| report.begun.len()).sum();
    add(|m| &mut m.begins, begins as f64);
    let bytes = simulation.bytes.iter().sum::<u64>() - before;
    add(|m| &mut m.message_bytes, bytes as f64);
    measured
}

fn within(what: &str, predicted: f64, measured: f64, share: f64) {
    let ratio = predicted / measured;
    assert!(
        (1.0 / (1.0 + share)..1.0 + share).contains(&ratio),
        "{what}: {predicted} on paper, {measured} measured"
    );
}

fn predict(crowd: &Crowd, network: &Network, margin: f32, measured: &Measured) -> Prediction {
    let machines = crowd.boxes.len() as f64;
    let scenario = Scenario {
        machines,
        boxes: f64::from(crowd.boxes[0]),
        slab: f64::from(crowd.length) / machines,
        beyond: crowd.beyond.unwrap_or(0.0).into(),
        size: 0.5,
        margin: margin.into(),
        speed: f64::from(crowd.speed) / 2.0,
        moving: 1.0,
        tick: TICK.as_secs_f64(),
        lease: f64::from(LEASE_MS) / 1e3,
        latency: (network.delay + network.jitter / 2).as_secs_f64(),
        loss: network.loss,
        begins: measured.begins,
        pairs: measured.pairs,
        bandwidth: 1.25e9,
    };
    scenario.predict()
}

#[test]
fn the_model_is_within_a_fifth_of_what_is_measured() {
    let ms = Duration::from_millis;
    let networks =
        [Network::default(), Network { delay: ms(20), loss: 0.01, ..Network::default() }];
    for (machines, network) in [2, 4, 8].into_iter().flat_map(|n| networks.map(|net| (n, net))) {
        let boxes = vec![12_000 / machines as u32; machines];
        let crowd = Crowd {
            length: 400.0,
            width: 25.0,
            speed: 0.4,
            beyond: Some(6.0),
            boxes,
            seed: 8,
            ..Crowd::default()
        };
        let measured = measure(crowd.clone(), network, 2.0);
        let predicted = predict(&crowd, &network, 2.0, &measured);
        println!("{machines} {network:?}\n  {predicted:?}\n  {measured:?}");
        within("bytes", predicted.all_message_bytes, measured.message_bytes, 0.2);
        let ghosts = predicted.ghosts * if machines == 2 { 2.0 } else { machines as f64 - 1.0 };
        within("ghosts", ghosts, measured.ghosts, 0.2);
        within("age of ghosts", predicted.ghost_age, measured.ghost_age, 0.2);
        within("age of reports", predicted.report_age, measured.report_age, 0.2);
        within("late pairs", predicted.late_pairs, measured.late_pairs, 0.2);
    }
}

#[test]
fn twice_as_many_boxes_far_from_borders_cost_nothing() {
    let of = |interior: u32| {
        let crowd = Crowd {
            length: 400.0,
            width: 25.0,
            speed: 0.4,
            beyond: Some(6.0),
            boxes: vec![3_000 + interior; 4],
            interior,
            seed: 8,
            ..Crowd::default()
        };
        measure(crowd, Network::default(), 2.0).message_bytes
    };
    let (once, twice) = (of(3_000), of(6_000));
    println!("{once} {twice}");
    assert!(twice < 1.02 * once, "{once} bytes a tick, and {twice} with twice the interior");
}
