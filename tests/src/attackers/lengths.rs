//! A client that states a length of its payload beyond its memory.

use std::time::Duration;

use pairmask_core::engine::EngineChoice;
use pairmask_wire::StatusCode;

use super::raw::{PAGE_COUNT, RawClient, answer, cull, dice, word, write};
use super::{Tally, Until, count, while_they_alternate};

/// Pages of a chunk; the whole segment has a few of them.
const PAGES: usize = 2;
/// More boxes than the whole segment could hold.
const TOO_MANY: [u32; 5] = [5_000, 20_000, 100_000, 1_000_000, 50_000_000];

pub fn attack(until: &Until, tally: &mut Tally) {
    let token = 1 << 41;
    let mut dice = dice();
    let mut frame = 0;
    while let Some(client) = RawClient::reconnect(token, PAGES, until) {
        while !until.is_over() {
            frame += 1;
            let Some(mut loan) = client.loan(PAGES) else { break };
            let n = TOO_MANY[dice.below(5) as usize];
            let needed = u64::from(n) * 24 / 4096 + 1;
            let forged = match dice.below(5) {
                0 => u64::MAX,
                // A number of pages whose bytes overflow 64 bits to 0.
                1 => 1 << 52,
                2 => (1 << 52) + needed,
                _ => needed,
            };
            *loan.user_header_mut() = cull(token, frame, n, EngineChoice::Auto);
            let pages = word(loan.header(), PAGE_COUNT);
            write(pages, forged);
            let Some(pending) = client.send(loan) else { break };
            // The length alternates between true and forged while the daemon reads it.
            let states: [&(dyn Fn() + Sync); 2] =
                [&|| write(pages, PAGES as u64), &|| write(pages, forged)];
            let said = while_they_alternate(dice.below(2) > 0, states, || {
                answer(&pending, Duration::from_millis(500))
            });
            write(pages, PAGES as u64);
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
