//! armwire-cli

fn main() {}
