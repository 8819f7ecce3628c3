//! Times of steps with avian's own broad phase and with pairmask: `cargo run --release --bin steps [BODIES..]`.

use std::ops::Range;
use std::time::{Duration, Instant};

use avian3d::collision::CollisionDiagnostics;
use avian3d::prelude::*;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use pairmask_avian::PairmaskBroadPhasePlugin;

/// Steps in which all bodies fall, but for the first, in which memory grows.
const FALLING: Range<usize> = 2..26;
/// Steps in which they lie on each other.
const RESTING: Range<usize> = 60..120;

fn main() {
    println!(
        "bodies             broad phase µs: avian  pairmask   whole update ms: avian  pairmask"
    );
    let mut sizes: Vec<usize> =
        std::env::args().skip(1).map(|n| n.parse().expect("a number of bodies")).collect();
    if sizes.is_empty() {
        sizes = vec![1_000, 4_000, 16_000];
    }
    for bodies in sizes {
        let [own, ours] = [false, true].map(|pairmask| measure(bodies, pairmask));
        for (phase, own, ours) in [("falling", own.0, ours.0), ("at rest", own.1, ours.1)] {
            println!(
                "{bodies:6} {phase} {:25.0} {:9.0} {:24.2} {:9.2}",
                own.broad * 1e6,
                ours.broad * 1e6,
                own.whole * 1e3,
                ours.whole * 1e3
            );
        }
    }
}

/// Seconds.
#[derive(Clone, Copy)]
struct Step {
    /// The broad phase, as avian's diagnostics have it: the mean, since all bodies leave their margins in the same
    /// few steps.
    broad: f64,
    /// The whole update: the median.
    whole: f64,
}

/// Steps in which bodies fall, and in which they rest.
fn measure(bodies: usize, pairmask: bool) -> (Step, Step) {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, TransformPlugin));
    if pairmask {
        let plugins = PhysicsPlugins::default().build().disable::<BvhBroadPhasePlugin>();
        app.add_plugins(plugins.add(PairmaskBroadPhasePlugin::<()>::default()));
    } else {
        app.add_plugins(PhysicsPlugins::default());
    }
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 64.0)));
    app.finish();
    let world = app.world_mut();
    let box_at = Transform::from_xyz(0.0, -0.5, 0.0);
    world.spawn((RigidBody::Static, Collider::cuboid(400.0, 1.0, 400.0), box_at));
    // Stacks of four, side by side in a square.
    let side = ((bodies / 4) as f32).sqrt().ceil() as usize;
    for i in 0..bodies {
        let (stack, y) = (i / 4, i % 4);
        let [x, z] = [stack % side, stack / side].map(|at| at as f32 * 1.1);
        let box_at = Transform::from_xyz(x, 0.7 + 1.2 * y as f32, z);
        world.spawn((
            RigidBody::Dynamic,
            Collider::cuboid(1.0, 1.0, 1.0),
            box_at,
            SleepingDisabled,
        ));
    }
    let (mut broad, mut whole) = (Vec::new(), Vec::new());
    for _ in 0..RESTING.end {
        let start = Instant::now();
        app.update();
        whole.push(start.elapsed().as_secs_f64());
        broad.push(app.world().resource::<CollisionDiagnostics>().broad_phase.as_secs_f64());
    }
    let of = |steps: Range<usize>| Step {
        broad: mean(&broad[steps.clone()]),
        whole: median(&whole[steps]),
    };
    (of(FALLING), of(RESTING))
}

fn mean(times: &[f64]) -> f64 {
    times.iter().sum::<f64>() / times.len() as f64
}

fn median(times: &[f64]) -> f64 {
    let mut times = times.to_vec();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
