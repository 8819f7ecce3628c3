//! A client that states a place of its payload beyond its memory.

use std::time::Duration;

use pairmask_core::engine::EngineChoice;
use pairmask_wire::StatusCode;

use super::raw::{RawClient, cull, dice, write};
use super::{Tally, Until, count, while_they_alternate};

/// Pages of a request; the whole of the memory has a few of them.
const PAGES: usize = 2;
/// More boxes than the whole of the memory could hold.
const TOO_MANY: [u32; 5] = [5_000, 20_000, 100_000, 1_000_000, 50_000_000];

pub fn attack(until: &Until, tally: &mut Tally) {
    let mut dice = dice();
    let mut frame = 0;
    while let Some(client) = RawClient::reconnect(PAGES, until) {
        while !until.is_over() {
            frame += 1;
            let Some(mut loan) = client.loan() else { break };
            let n = TOO_MANY[dice.below(5) as usize];
            let needed = u64::from(n) * 24 / 4096 + 1;
            let honest = loan.placed;
            let forged = match dice.below(7) {
                0 => [0, honest.offset, u64::MAX],
                // A number of pages whose bytes overflow 64 bits to 0.
                1 => [0, honest.offset, 1 << 52],
                2 => [0, honest.offset, (1 << 52) + needed],
                3 => [0, !4095, needed],
                4 => [0, honest.offset + 8, PAGES as u64],
                5 => [1 + dice.below(u64::MAX - 1), honest.offset, needed],
                _ => [0, honest.offset, needed],
            };
            loan.header = cull(frame, n, EngineChoice::Auto);
            let entry = client.board().entry(loan.place);
            let put = |words: [u64; 3]| {
                words.into_iter().enumerate().for_each(|(at, word)| write(entry + 8 * at, word));
            };
            let [segment, offset, pages] = forged;
            loan.placed = pairmask_wire::board::Placed { segment, offset, pages };
            let pending = client.send(loan);
            // The place alternates between true and forged while the daemon reads it.
            let right = [honest.segment, honest.offset, honest.pages];
            let states: [&(dyn Fn() + Sync); 2] = [&|| put(right), &|| put(forged)];
            let said = while_they_alternate(dice.below(2) > 0, states, || {
                pending.answer(Duration::from_millis(500))
            });
            count(tally, "rounds");
            match said {
                // The attacker has no such memory: the daemon must have read another client's.
                Some(header) if header.status == StatusCode::Ok as u32 => count(tally, "outside"),
                Some(_) => count(tally, "refused"),
                None => {
                    count(tally, "silent");
                    break;
                }
            }
        }
    }
}
