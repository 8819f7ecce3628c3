//! A client that truncates its segment while the daemon reads it.

use std::fs::OpenOptions;
use std::time::Duration;

use pairmask_core::engine::EngineChoice;

use super::raw::{RawClient, answer, cull, dice, segment_file};
use super::{Tally, count};

const BOXES: u32 = 20_000;
const PAGES: usize = 20_000 * 24 / 4096 + 1;

pub fn attack(tally: &mut Tally) {
    let token = 1 << 45;
    let mut dice = dice();
    let Some(client) = RawClient::connect(token, PAGES) else { return };
    let Some(mut loan) = client.loan(PAGES) else { return };
    *loan.user_header_mut() = cull(token, 1, BOXES, EngineChoice::Auto);
    let Some(path) = segment_file(client.ports.port.id().value()) else { return };
    let Some(pending) = client.send(loan) else { return };
    std::thread::sleep(Duration::from_micros(dice.below(400)));
    let Ok(file) = OpenOptions::new().write(true).open(path) else { return };
    // The headers' page stays, so that the attacker can receive the answer.
    if file.set_len(4096 * (1 + dice.below(8))).is_ok() {
        count(tally, "rounds");
    }
    if answer(&pending, Duration::from_millis(100)).is_some() {
        count(tally, "answered");
    }
    // The rest of the memory must not be touched, not even to drop it.
    std::mem::forget((pending, client));
}
