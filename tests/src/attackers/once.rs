//! Attacks that break the attacker's own memory: each round is a process of its own.

use std::fs::{self, OpenOptions};
use std::os::unix::fs::FileExt;
use std::time::Duration;

use pairmask_core::engine::EngineChoice;

use super::raw::{CHANNEL_ID, RawClient, answer, cull, dice, segment_file, word, write};
use super::{Tally, count};

const BOXES: u32 = 20_000;
const PAGES: usize = 20_000 * 24 / 4096 + 1;

/// A client that asks for its answer on a channel that does not exist.
pub fn channels(tally: &mut Tally) {
    let token = 1 << 42;
    let Some(client) = RawClient::connect(token, 1) else { return };
    let Some(mut loan) = client.loan(1) else { return };
    *loan.user_header_mut() = cull(token, 1, 2, EngineChoice::Auto);
    write(word(loan.header(), CHANNEL_ID), 1 << 40);
    let Some(pending) = client.send(loan) else { return };
    count(tally, "rounds");
    if answer(&pending, Duration::from_millis(200)).is_some() {
        count(tally, "answered");
    }
}

/// A client that truncates its segment while the daemon reads it.
pub fn truncate(tally: &mut Tally) {
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

/// A client that writes random words at random places of the queues between it and the daemon.
pub fn scribble(tally: &mut Tally) {
    let token = 1 << 44;
    let mut dice = dice();
    let Some(client) = RawClient::connect(token, 1) else { return };
    let Some(mut loan) = client.loan(1) else { return };
    *loan.user_header_mut() = cull(token, 1, 2, EngineChoice::Auto);
    let Some(pending) = client.send(loan) else { return };
    answer(&pending, Duration::from_millis(100));
    let queues = own_queues(client.ports.port.id().value());
    if queues.is_empty() {
        return;
    }
    for _ in 0..16 {
        let path = &queues[dice.below(queues.len() as u64) as usize];
        let Ok(file) = OpenOptions::new().write(true).open(path) else { continue };
        let words = file.metadata().map_or(1, |data| data.len() / 8).max(1);
        let value = match dice.below(4) {
            0 => u64::MAX,
            1 => 1,
            2 => 1 << 40,
            _ => dice.below(u64::MAX),
        };
        // The file may no longer exist; the write may then fail.
        let _ = file.write_all_at(&value.to_ne_bytes(), 8 * dice.below(words));
        count(tally, "words");
        let _ = client.ports.notifier.notify();
    }
    std::thread::sleep(Duration::from_millis(20));
    count(tally, "rounds");
    // The client must not use its own queues any more, not even to drop them.
    std::mem::forget((pending, client));
}

/// The files of the queues between a port and the daemon.
fn own_queues(port: u128) -> Vec<String> {
    let maps = fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let name = port.to_string();
    let mut found: Vec<String> = maps
        .lines()
        .filter_map(|line| line.split_whitespace().nth(5))
        .filter(|path| path.contains(&name) && path.contains(".connection"))
        .map(str::to_owned)
        .collect();
    found.sort();
    found.dedup();
    found
}
