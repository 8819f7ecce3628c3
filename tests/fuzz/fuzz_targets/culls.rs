//! libFuzzer drives [`culls`](pairmask_fuzz::culls).
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| pairmask_fuzz::culls::decode(data));
