//! armwire-firmware

fn main() {}
