//! Random numbers of tests: xorshift.

pub struct Random(pub u64);

impl Random {
    pub const fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 >> 11
    }

    pub const fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }
}
