//! Lists the frames that a Ling arm sent, with their meaning, and the bytes between them.
//!
//! Usage: decode [FILE]. Without a file it lists a sample.

use std::error::Error;
use std::{env, fs};

use armwire::decoder::{Decoder, Item, Kind};
use armwire::ling::{Ling, MAX_FRAME};
use armwire::messages::Messages;

/// A pose, a stray byte, and the temperatures of ten servos.
const SAMPLE: &[u8] = b"\xAA\x06\x00\x0F\x00\x08\x34\x08\x6C\x07\x00\x08\x00\x08\x00\x0A\xF4\x01\x10\x90\xFF\
    \x11\
    \xAA\x06\x01\x0A\x23\x23\x23\x23\x23\x23\x23\x23\x23\x23\x83\xFF";

fn main() -> Result<(), Box<dyn Error>> {
    let bytes = match env::args().nth(1) {
        Some(file) => fs::read(file)?,
        None => SAMPLE.to_vec(),
    };
    let mut decoder = Decoder::<Ling, MAX_FRAME>::new();
    let mut rest = bytes.as_slice();
    while !rest.is_empty() {
        // The decoder takes as many bytes as it has room for.
        rest = decoder.push(rest);
        while let Some(item) = decoder.next(&Ling, ()) {
            print(&item);
        }
    }
    // No byte follows: the start of a frame is noise now.
    decoder.idle();
    while let Some(item) = decoder.next(&Ling, ()) {
        print(&item);
    }
    Ok(())
}

fn print(item: &Item<'_>) {
    let Item { offset, kind, bytes } = item;
    print!("{offset:6}  {bytes:02X?}  ");
    match kind {
        Kind::Frame => match Ling.parse_response(bytes, ()) {
            Ok(response) => println!("{response}"),
            Err(error) => println!("unknown: {error}"),
        },
        Kind::Noise(reason) | Kind::Broken(reason) => println!("{reason}"),
        Kind::Padding => println!("padding"),
    }
}
