//! Tells the linker which script places the program in memory: esp-hal's.

fn main() {
    println!("cargo:rustc-link-arg-bins=-Tlinkall.x");
}
