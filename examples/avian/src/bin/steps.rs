//! Times of steps with avian's own broad phase and with pairmask: `cargo run --release --bin steps`.

use std::time::{Duration, Instant};

use avian3d::collision::CollisionDiagnostics;
use avian3d::prelude::*;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use pairmask_avian::PairmaskBroadPhasePlugin;

/// Steps before times count: bodies fall onto each other, and memory has grown.
const WARM_STEPS: usize = 60;
/// Steps that are timed. Their medians are told.
const STEPS: usize = 60;

fn main() {
    println!("bodies  broad phase µs: avian  pairmask   whole update ms: avian  pairmask");
    for bodies in [1_000, 4_000, 16_000] {
        let [own, ours] = [false, true].map(|pairmask| measure(bodies, pairmask));
        println!(
            "{bodies:6} {:22.0} {:9.0} {:24.2} {:9.2}",
            own.0 * 1e6,
            ours.0 * 1e6,
            own.1 * 1e3,
            ours.1 * 1e3
        );
    }
}

/// Medians in seconds: the broad phase as avian's diagnostics have it, and the whole update.
fn measure(bodies: usize, pairmask: bool) -> (f64, f64) {
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
    let place = Transform::from_xyz(0.0, -0.5, 0.0);
    world.spawn((RigidBody::Static, Collider::cuboid(400.0, 1.0, 400.0), place));
    // Stacks of four, side by side in a square.
    let side = ((bodies / 4) as f32).sqrt().ceil() as usize;
    for i in 0..bodies {
        let (stack, y) = (i / 4, i % 4);
        let [x, z] = [stack % side, stack / side].map(|at| at as f32 * 1.1);
        let place = Transform::from_xyz(x, 0.7 + 1.2 * y as f32, z);
        world.spawn((RigidBody::Dynamic, Collider::cuboid(1.0, 1.0, 1.0), place, SleepingDisabled));
    }
    (0..WARM_STEPS).for_each(|_| app.update());
    let (mut broad, mut whole) = (Vec::new(), Vec::new());
    for _ in 0..STEPS {
        let start = Instant::now();
        app.update();
        whole.push(start.elapsed().as_secs_f64());
        broad.push(app.world().resource::<CollisionDiagnostics>().broad_phase.as_secs_f64());
    }
    let median = |mut times: Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    (median(broad), median(whole))
}
