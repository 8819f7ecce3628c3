//! A process that attacks the daemon or its clients: `attacker MODE`, with the daemon's directory in
//! `PAIRMASK_RUNTIME_DIR`. Goes on until its input ends, then prints what it counted.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    pairmask_tests::attackers::run(&std::env::args().nth(1).unwrap_or_default())
}
