//! The version, which `init` compares between header and library.

/// The version of this header: 0xMMmmpp. Every `init` function takes it.
pub const ARMWIRE_VERSION: u32 = 0x00_02_00;

// The constant is written out for the header, and must be the package's version.
const _: () = assert!(ARMWIRE_VERSION == of_package());

const fn of_package() -> u32 {
    number(env!("CARGO_PKG_VERSION_MAJOR")) << 16
        | number(env!("CARGO_PKG_VERSION_MINOR")) << 8
        | number(env!("CARGO_PKG_VERSION_PATCH"))
}

const fn number(text: &str) -> u32 {
    match u8::from_str_radix(text, 10) {
        Ok(number) => number as u32,
        Err(_) => panic!("a part of the version is not a number up to 255"),
    }
}

/// The version of the library: 0xMMmmpp.
#[unsafe(no_mangle)]
pub const extern "C" fn armwire_version() -> u32 {
    ARMWIRE_VERSION
}
