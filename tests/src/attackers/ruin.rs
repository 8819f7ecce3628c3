//! Clients that ruin the memory that they share with the daemon, all of it, and cut it while the daemon reads it.

use std::time::Duration;

use pairmask_core::engine::EngineChoice;
use rustix::fs::ftruncate;

use super::raw::{RawClient, cull, dice, say_bytes, write};
use super::{Tally, Until, count};

const BOXES: u32 = 20_000;
const PAGES: usize = 20_000 * 24 / 4096 + 1;

/// Writes random words at random places: mostly of the board, while requests are under way.
pub fn scribble(until: &Until, tally: &mut Tally) {
    let mut dice = dice();
    while let Some(client) = RawClient::reconnect(1, until) {
        for frame in 0..8 {
            // What it wrote before may be why the daemon lets go of nothing.
            if let Some(mut loan) = client.loan_within(Duration::from_millis(1)) {
                loan.header = cull(frame, 2, EngineChoice::Auto);
                let pending = client.send(loan);
                pending.answer(Duration::from_millis(1));
            }
            let memory = client.memory.mapped;
            for _ in 0..64 {
                let value = match dice.below(4) {
                    0 => u64::MAX,
                    1 => 1,
                    2 => 1 << 40,
                    _ => dice.below(u64::MAX),
                };
                // The words of the board, its entries, or anything.
                let reach = [192, 3 * 4096, memory.bytes as u64][dice.below(3) as usize];
                write(memory.start + 8 * dice.below(reach / 8) as usize, value);
                count(tally, "words");
                client.wake();
            }
        }
        // Words on the socket, with or without descriptors.
        let words: Vec<u8> = (0..dice.below(40)).map(|_| dice.below(256) as u8).collect();
        let files = vec![&client.memory.file; dice.below(4) as usize];
        let _ = say_bytes(&client.socket, &words, &files);
        count(tally, "rounds");
    }
}

/// Cuts its memory while the daemon reads it.
pub fn truncate(until: &Until, tally: &mut Tally) {
    let mut dice = dice();
    while let Some(client) = RawClient::reconnect(PAGES, until) {
        let Some(mut loan) = client.loan() else { continue };
        loan.header = cull(1, BOXES, EngineChoice::Auto);
        let pending = client.send(loan);
        std::thread::sleep(Duration::from_micros(dice.below(400)));
        // From nothing at all on, the board too.
        if ftruncate(&client.memory.file, 4096 * dice.below(40)).is_ok() {
            count(tally, "rounds");
        }
        if pending.answer(Duration::from_millis(20)).is_some() {
            count(tally, "answered");
        }
        // The rest of the memory must not be touched, not even to let go of the answer.
        std::mem::forget(pending);
    }
}
