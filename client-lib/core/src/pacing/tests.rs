//! Schedules of clients, played against a clock that only they move.

use super::*;

const US: Duration = Duration::from_micros(1);
const MS: Duration = Duration::from_millis(1);

/// What a server that follows a pace would have seen.
#[derive(Debug, Default)]
struct Played {
    requests: u32,
    /// Requests that came while it was awake.
    awaited: u32,
    awake: Duration,
    took: Duration,
}

impl Played {
    fn awaited_share(&self) -> f64 {
        f64::from(self.awaited) / f64::from(self.requests)
    }

    fn awake_share(&self) -> f64 {
        self.awake.as_secs_f64() / self.took.as_secs_f64()
    }
}

/// Plays requests, each a client and a time after the start, in order of time.
fn play(pacing: &mut Pacing<u32>, start: Instant, requests: &[(u32, Duration)]) -> Played {
    let mut played = Played::default();
    let mut now = start;
    for (client, after) in requests {
        let at = start + *after;
        let mut is_awaited = false;
        while let Some(wake) = pacing.next_wake(now).filter(|wake| wake.sleep_until < at) {
            assert!(wake.spin_until > now, "a window that has passed is none");
            let until = wake.spin_until.min(at);
            played.awake += until.saturating_duration_since(wake.sleep_until.max(now));
            is_awaited = wake.spin_until >= at;
            if is_awaited {
                break;
            }
            now = until;
        }
        played.requests += 1;
        played.awaited += u32::from(is_awaited);
        now = at;
        pacing.note_request(*client, at);
    }
    played.took = now - start;
    played
}

/// Random numbers from 0 to 1, the same in every run.
fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    }
}

/// `frames` frames of a client, each up to `jitter` late.
fn paced(hertz: u32, frames: u32, jitter: Duration, seed: u64) -> Vec<(u32, Duration)> {
    let mut next = random(seed);
    let due = |frame| Duration::from_secs(1) * frame / hertz;
    (1..=frames).map(|frame| (0, due(frame) + jitter.mul_f64(next()))).collect()
}

/// Several clients' requests in order of time.
fn together(clients: &[Vec<(u32, Duration)>]) -> Vec<(u32, Duration)> {
    let named = |(client, requests): (usize, &Vec<(u32, Duration)>)| {
        requests.iter().map(|(_, at)| (client as u32, *at)).collect::<Vec<_>>()
    };
    let mut all: Vec<_> = clients.iter().enumerate().flat_map(named).collect();
    all.sort_by_key(|(_, at)| *at);
    all
}

#[test]
fn steady_clients_are_awaited_and_cost_little() {
    for (hertz, most_awake) in [(30, 0.015), (60, 0.027), (144, 0.065), (240, 0.11), (500, 0.17)] {
        for jitter in [Duration::ZERO, 30 * US, 100 * US] {
            let mut pacing = Pacing::default();
            let played = play(&mut pacing, Instant::now(), &paced(hertz, 1000, jitter, 1));
            assert!(played.awaited_share() > 0.97, "{hertz} Hz, {jitter:?}: {played:?}");
            assert!(played.awake_share() < most_awake, "{hertz} Hz, {jitter:?}: {played:?}");
        }
    }
}

#[test]
fn a_spread_beyond_the_budget_is_not_paid_for() {
    // Frames 60 times a second, each at any time within 10 ms.
    let mut pacing = Pacing::default();
    let played = play(&mut pacing, Instant::now(), &paced(60, 1000, 10 * MS, 2));
    assert!(played.awake_share() < 0.005, "{played:?}");
    // Requests at random times.
    let (mut next, mut at) = (random(3), Duration::ZERO);
    let requests: Vec<_> = (0..2000)
        .map(|_| {
            at += MS + (30 * MS).mul_f64(next());
            (0, at)
        })
        .collect();
    let played = play(&mut Pacing::default(), Instant::now(), &requests);
    assert!(played.awake_share() < 0.005, "{played:?}");
}

#[test]
fn a_pace_that_breaks_is_cold_for_a_few_frames_and_then_learned_again() {
    let period = 4 * MS;
    let mut at = Duration::ZERO;
    let mut requests = Vec::new();
    let mut add = |period: Duration, frames: u32, requests: &mut Vec<(u32, Duration)>| {
        for _ in 0..frames {
            at += period;
            requests.push((0, at));
        }
    };
    add(period, 100, &mut requests);
    // A frame that takes three periods, then on; a pause of a loading screen; another pace.
    add(3 * period, 1, &mut requests);
    add(period, 100, &mut requests);
    add(5000 * MS, 1, &mut requests);
    add(period, 100, &mut requests);
    add(16 * MS, 100, &mut requests);
    let played = play(&mut Pacing::default(), Instant::now(), &requests);
    let cold = played.requests - played.awaited;
    assert!((12..=40).contains(&cold), "{played:?}");
    assert!(played.awake_share() < 0.05, "nobody is awake in the pause: {played:?}");
}

#[test]
fn a_client_that_is_ended_is_awaited_for_a_moment_only() {
    let start = Instant::now();
    let mut pacing = Pacing::default();
    play(&mut pacing, start, &paced(60, 100, Duration::ZERO, 1));
    let mut now = start + Duration::from_secs(100) / 60;
    let mut wakes = 0;
    while let Some(wake) = pacing.next_wake(now) {
        assert!(wake.spin_until > now && wake.sleep_until < wake.spin_until);
        now = wake.spin_until;
        wakes += 1;
    }
    assert_eq!(wakes, 3, "the next beat, and two more");
}

#[test]
fn clients_of_differing_paces_are_all_awaited() {
    let clients =
        [paced(60, 600, 20 * US, 1), paced(90, 900, 20 * US, 2), paced(30, 300, 20 * US, 3)];
    let played = play(&mut Pacing::default(), Instant::now(), &together(&clients));
    assert!(played.awaited_share() > 0.95, "{played:?}");
    assert!(played.awake_share() < 0.09, "{played:?}");
}

#[test]
fn many_clients_share_a_part_of_a_core() {
    let clients: Vec<_> = (0..32)
        .map(|client| {
            let mut requests = paced(240, 500, Duration::ZERO, client);
            for (_, at) in &mut requests {
                *at += 130 * US * client as u32;
            }
            requests
        })
        .collect();
    let mut pacing = Pacing::default();
    let played = play(&mut pacing, Instant::now(), &together(&clients));
    assert!(played.awake_share() < 0.30, "{played:?}");
}

#[test]
fn a_closed_loop_has_no_window() {
    let requests: Vec<_> = (1..5000).map(|frame| (0, 40 * US * frame)).collect();
    let played = play(&mut Pacing::default(), Instant::now(), &requests);
    assert!(played.awake_share() < 0.35, "{played:?}");
}

#[test]
fn clients_without_end_take_no_memory_and_drop_the_silent_ones() {
    let start = Instant::now();
    let mut pacing = Pacing::default();
    for client in 0..10_000 {
        pacing.note_request(client, start + MS * client);
    }
    assert_eq!(pacing.clients.len(), MOST_CLIENTS);
    assert!(pacing.clients.iter().all(|(client, _)| *client >= 10_000 - MOST_CLIENTS as u32));
}

#[test]
fn any_instants_are_taken() {
    let (start, mut next) = (Instant::now() + Duration::from_secs(100), random(9));
    let mut pacing = Pacing::default();
    for step in 0..20_000_u32 {
        // To and fro, by nanoseconds and by minutes.
        let scale = 10_f64.powf(11.0 * next());
        let at = start + Duration::from_nanos(scale as u64);
        pacing.note_request(step % 70, at);
        if let Some(wake) = pacing.next_wake(at) {
            assert!(wake.spin_until > at && wake.sleep_until < wake.spin_until);
        }
    }
}
