//! A client that asks for its answer on a channel that does not exist.

use std::time::Duration;

use pairmask_core::engine::EngineChoice;

use super::raw::{CHANNEL_ID, RawClient, answer, cull, word, write};
use super::{Tally, count};

pub fn attack(tally: &mut Tally) {
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
