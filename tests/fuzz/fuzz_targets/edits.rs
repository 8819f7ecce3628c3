//! libFuzzer drives [`edits`](pairmask_fuzz::edits).
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| pairmask_fuzz::edits::decode(data));
