//! The cases on a host, to be run under callgrind.

fn main() {
    armwire_counts::run();
}
