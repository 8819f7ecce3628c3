//! What a scene over several machines costs by the [model](pairmask_bridge::model), as a line of JSON:
//! `paper --machines 100 --boxes 1000000 --slab 1000`.

use clap::Parser;
use pairmask_bridge::model::{Prediction, Scenario};

/// Lengths in units of the scene, times in seconds.
#[derive(Debug, Parser)]
struct Arguments {
    #[arg(long)]
    machines: f64,
    /// Of each machine.
    #[arg(long)]
    boxes: f64,
    /// Width of a machine's slab.
    #[arg(long)]
    slab: f64,
    /// How far boxes walk beyond their machine's slab.
    #[arg(long, default_value_t = 0.0)]
    beyond: f64,
    /// How long a box is along the axis.
    #[arg(long, default_value_t = 1.0)]
    size: f64,
    #[arg(long, default_value_t = 5.0)]
    margin: f64,
    /// Along the axis, whichever way, in a tick.
    #[arg(long, default_value_t = 0.02)]
    speed: f64,
    /// The share of boxes that move in a tick.
    #[arg(long, default_value_t = 0.3)]
    moving: f64,
    #[arg(long, default_value_t = 1.0 / 60.0)]
    tick: f64,
    #[arg(long, default_value_t = 1.0)]
    lease: f64,
    /// One way.
    #[arg(long, default_value_t = 0.000_5)]
    latency: f64,
    /// The share of messages that is lost.
    #[arg(long, default_value_t = 0.000_1)]
    loss: f64,
    /// Bytes a second.
    #[arg(long, default_value_t = 25e9 / 8.0)]
    bandwidth: f64,
}

fn main() {
    let of = Arguments::parse();
    let scenario = Scenario {
        machines: of.machines,
        boxes: of.boxes,
        slab: of.slab,
        beyond: of.beyond,
        size: of.size,
        margin: of.margin,
        speed: of.speed,
        moving: of.moving,
        tick: of.tick,
        lease: of.lease,
        latency: of.latency,
        loss: of.loss,
        // These decide about late pairs alone, which are not printed.
        pairs: 1.0,
        begins: 0.0,
        bandwidth: of.bandwidth,
    };
    let Prediction {
        ghosts,
        message_bytes,
        all_message_bytes,
        link_bytes,
        link_share,
        messages_a_second,
        ghost_age,
        report_age,
        ..
    } = scenario.predict();
    println!(
        "{{\"ghosts\":{ghosts},\"message_bytes\":{message_bytes},\"all_message_bytes\":{all_message_bytes},\
         \"link_bytes\":{link_bytes},\"link_share\":{link_share},\"messages_a_second\":{messages_a_second},\
         \"ghost_age\":{ghost_age},\"report_age\":{report_age}}}"
    );
}
