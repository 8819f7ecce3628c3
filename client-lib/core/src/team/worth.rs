//! How many threads a frame is worth: its time against the CPU time that it takes from others.

// Of `cpu-grid` on 16 cores of an H100 host, 10,000 to 300,000 boxes. There 10,000 boxes take a daemon .42 ms and .50 of
// CPU time on one thread, .38 and .84 on two, .26 and 1.17 on four, .22 and 2.0 on eight, .22 and 3.2 on 16; 100,000 take
// 4.6 and 6.0, 3.2 and 7.2, 2.1 and 8.3, 1.5 and 10.5, 1.5 and 19.1.

/// Share of a frame's time on one thread that further threads do not shorten.
const SERIAL_SHARE: f64 = 0.12;

/// How late a thread comes that was called, and how long it looks for work when the frame is done, ns: waking takes 50
/// to 100 µs on a virtual machine.
const LATE_NS: f64 = 80_000.0;

/// What a ms of CPU time is worth, in ms of a frame of [`SHORT_NS`]: a thread is added while it shortens the frame by
/// this share of what it costs.
const WORTH: f64 = 0.17;

/// The longer a frame, the more its time counts beside its CPU time, by the third root of its length: that of 10,000
/// boxes, .4 to .6 ms, has four threads, that of 100,000 eight to ten, that of a million nearly all of 16.
const SHORT_NS: f64 = 400_000.0;

/// Time on `threads` threads of what takes `one_ns` on one (Amdahl's law).
pub(crate) fn time_ns(one_ns: f64, threads: usize) -> f64 {
    time_by_share(one_ns, SERIAL_SHARE, threads)
}

fn time_by_share(one_ns: f64, serial_share: f64, threads: usize) -> f64 {
    let threads = threads.max(1) as f64;
    one_ns * (serial_share + (1.0 - serial_share) / threads) + LATE_NS * (1.0 - 1.0 / threads)
}

/// Threads, at most `most`, that work of `one_ns` on one of them is worth.
pub(crate) fn threads_worth(one_ns: f64, most: usize) -> usize {
    worth_by_share(one_ns, SERIAL_SHARE, most)
}

fn worth_by_share(one_ns: f64, serial_share: f64, most: usize) -> usize {
    let time_ns = |threads| time_by_share(one_ns, serial_share, threads);
    let worth = WORTH * (SHORT_NS / one_ns.max(SHORT_NS)).cbrt();
    let is_worth = |threads: usize| {
        let (before, after) = (time_ns(threads - 1), time_ns(threads));
        // Threads that wait for each other spin.
        let cost = threads as f64 * after - (threads - 1) as f64 * before;
        before - after >= worth * cost
    };
    // Each further thread gains less than the one before.
    (2..=most).take_while(|threads| is_worth(*threads)).last().unwrap_or(1)
}

/// Threads that may be used where so many are asked for: no more than the calling thread's pool has, all of them for
/// `None`. A frame of one thread asks for no pool: outside of one, that would start the global pool.
pub(crate) fn most_threads(asked: Option<usize>) -> usize {
    if matches!(asked, Some(0 | 1)) {
        return 1;
    }
    let pool = rayon::current_num_threads();
    asked.map_or(pool, |asked| asked.min(pool))
}

/// Threads that work of `one_ns` is worth, of those that may be used. Short work asks for no pool.
pub(crate) fn threads_for(one_ns: f64, asked: Option<usize>) -> usize {
    threads_by_share(one_ns, SERIAL_SHARE, asked)
}

/// The same for work of which further threads do not shorten another share.
pub(crate) fn threads_by_share(one_ns: f64, serial_share: f64, asked: Option<usize>) -> usize {
    let worth = |most| worth_by_share(one_ns, serial_share, most);
    if worth(2) == 1 { 1 } else { worth(most_threads(asked)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_frames_have_one_thread_and_long_ones_nearly_all() {
        let chosen = |us: f64| threads_worth(us * 1e3, 16);
        assert_eq!([10.0, 100.0].map(chosen), [1, 1]);
        assert_eq!([400.0, 500.0, 600.0].map(chosen), [4; 3]);
        assert!((8..=10).contains(&chosen(4_600.0)), "{}", chosen(4_600.0));
        assert!((14..=16).contains(&chosen(80_000.0)), "{}", chosen(80_000.0));
        assert_eq!([0.0, -1.0, f64::NAN].map(|ns| threads_worth(ns, 16)), [1; 3]);
        assert_eq!([0, 1, 2].map(|most| threads_worth(1e9, most)), [1, 1, 2]);
    }

    #[test]
    fn longer_frames_have_no_fewer_threads() {
        let frames = (0..200).map(|step| 1e3 * 1.1f64.powi(step));
        assert!(frames.map(|ns| threads_worth(ns, 64)).is_sorted());
    }
}
