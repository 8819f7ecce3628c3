//! libFuzzer drives [`requests`](pairmask_fuzz::requests).
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| pairmask_fuzz::requests::decode(data));
