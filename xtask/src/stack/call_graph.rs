//! The functions of a linked program: what each takes of the stack, and whom it calls.

use std::collections::BTreeMap;

use object::read::elf::ElfFile32;
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SymbolKind};

use super::thumb::{self, Effect};
use crate::Result;

/// The functions of a program.
#[derive(Debug)]
pub(crate) struct CallGraph {
    /// By address.
    functions: BTreeMap<u32, Function>,
    /// The addresses of those with a name for the linker of their own, by name. Functions that are the same are one.
    global: BTreeMap<String, u32>,
}

/// A function.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Function {
    /// As the linker knows it.
    name: String,
    /// Where it ends.
    end: u32,
    /// Bytes of stack it takes itself.
    frame: u32,
    /// What it calls while it has them.
    calls: Vec<u32>,
    /// What goes on in its place once it has given them up.
    jumps: Vec<u32>,
    /// Whether it calls what a pointer points at.
    pointers: bool,
}

/// The most stack that a function takes, with all it calls.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Depth {
    /// In bytes.
    pub(crate) bytes: u32,
    /// Who takes how much of it, from the function on down.
    pub(crate) path: Vec<(String, u32)>,
}

impl CallGraph {
    /// That of the program in an ELF file for a Cortex-M.
    ///
    /// # Errors
    ///
    /// If it is no such file, or if the stack that a function takes is in neither the compiler's own table nor its code.
    pub(crate) fn parse(file: &[u8]) -> Result<Self> {
        let elf: ElfFile32<'_, Endianness> = ElfFile32::parse(file)?;
        let text = elf.section_by_name(".text").ok_or("the program has no .text")?;
        let (start, code) = (u32::try_from(text.address())?, text.data()?);
        let said = match elf.section_by_name(".stack_sizes") {
            Some(sizes) => stack_sizes(sizes.data()?)?,
            None => return Err("the program has no .stack_sizes".into()),
        };

        let (mut functions, mut global) = (BTreeMap::new(), BTreeMap::new());
        // Whether what begins there is code or data, as $t and $d say.
        let mut is_code = BTreeMap::new();
        for symbol in elf
            .symbols()
            .filter(|symbol| symbol.section_index() == Some(text.index()))
        {
            let (name, address) = (symbol.name()?, u32::try_from(symbol.address())?);
            if name.starts_with("$t") || name.starts_with("$d") {
                is_code.insert(address, name.starts_with("$t"));
            } else if symbol.kind() == SymbolKind::Text {
                // The lowest bit says that it is Thumb.
                let address = address & !1;
                let function = functions.entry(address).or_insert_with(Function::default);
                function.name = format!("{:#}", rustc_demangle::demangle(name));
                function.end = function.end.max(address + u32::try_from(symbol.size())?);
                if symbol.is_global() {
                    global.insert(name.to_owned(), address);
                }
            }
        }
        for (&address, function) in &mut functions {
            let bytes = code
                .get((address - start) as usize..(function.end - start) as usize)
                .ok_or_else(|| format!("`{}` is not within .text", function.name))?;
            let is_code = |at: u32| is_code.range(..=at).next_back().is_some_and(|(_, code)| *code);
            function.read(address, bytes, is_code, said.get(&address).copied())?;
        }
        Ok(Self { functions, global })
    }

    /// The functions whose name was given them in Rust's way, by name, and the most stack each takes.
    pub(crate) fn entry_points(&self) -> BTreeMap<&str, Result<Depth>> {
        let rust = self.global.iter().filter(|(name, _)| name.contains("::"));
        rust.map(|(name, &address)| (&**name, self.depth(address, &mut Vec::new())))
            .collect()
    }

    /// The most stack that the function at this address takes.
    ///
    /// # Errors
    ///
    /// If that cannot be told: if it, or what it calls, calls itself or what a pointer points at.
    fn depth(&self, address: u32, callers: &mut Vec<u32>) -> Result<Depth> {
        let function = self
            .functions
            .get(&address)
            .ok_or_else(|| format!("there is no function at {address:#x}"))?;
        if let Some(first) = callers.iter().position(|caller| *caller == address) {
            let cycle = callers[first..].iter().chain([&address]);
            let names: Vec<&str> = cycle.map(|caller| &*self.functions[caller].name).collect();
            return Err(format!("recursion: {}", names.join(" calls ")).into());
        }
        if function.pointers {
            return Err(format!("`{}` calls what a pointer points at", function.name).into());
        }
        let mut deepest = Depth {
            bytes: function.frame,
            path: vec![(function.name.clone(), function.frame)],
        };
        callers.push(address);
        let calls = function.calls.iter().map(|call| (function.frame, call));
        let jumps = function.jumps.iter().map(|jump| (0, jump));
        for (frame, &callee) in calls.chain(jumps) {
            let below = self.depth(callee, callers)?;
            if frame + below.bytes > deepest.bytes {
                deepest.bytes = frame + below.bytes;
                deepest.path.truncate(1);
                deepest.path[0].1 = frame;
                deepest.path.extend(below.path);
            }
        }
        callers.pop();
        Ok(deepest)
    }
}

impl Function {
    /// Reads the function's machine code. `said` is the stack it takes, if the compiler says that.
    fn read(&mut self, address: u32, code: &[u8], is_code: impl Fn(u32) -> bool, said: Option<u32>) -> Result {
        let (mut grown, mut by_register) = (0, false);
        let mut halfwords = (address..).step_by(2).zip(code.as_chunks().0);
        while let Some((at, &first)) = halfwords.next() {
            if !is_code(at) {
                continue;
            }
            let first = u16::from_le_bytes(first);
            let effect = match thumb::is_wide(first) {
                false => thumb::narrow(at, first),
                true => {
                    let second = halfwords
                        .next()
                        .ok_or_else(|| format!("`{}` ends in an instruction", self.name))?;
                    thumb::wide(at, first, u16::from_le_bytes(*second.1))
                }
            };
            match effect {
                Effect::None => {}
                Effect::Grow(bytes) => grown += bytes,
                Effect::GrowByRegister => by_register = true,
                // ARMv6-M's far jump is a call.
                Effect::Call(to) | Effect::Jump(to) if (address + 1..self.end).contains(&to) => {}
                Effect::Jump(to) if to == address => {}
                Effect::Call(callee) => self.calls.push(callee),
                Effect::Jump(to) => self.jumps.push(to),
                Effect::Pointer => self.pointers = true,
            }
        }
        self.frame = match said {
            // What is pushed on several ways through the function counts once for the compiler, and each time here.
            Some(said) if said <= grown || by_register => said,
            Some(said) => {
                return Err(format!("`{}` takes {said} bytes of stack, but its code {grown}", self.name).into());
            }
            None if by_register => {
                return Err(format!("`{}` takes as much stack as a register says", self.name).into());
            }
            None => grown,
        };
        self.calls.sort_unstable();
        self.calls.dedup();
        self.jumps.sort_unstable();
        self.jumps.dedup();
        Ok(())
    }
}

/// The compiler's table of stack sizes, by the function's address: each is an address and a ULEB128.
fn stack_sizes(mut table: &[u8]) -> Result<BTreeMap<u32, u32>> {
    let mut sizes = BTreeMap::new();
    while let Some((address, rest)) = table.split_first_chunk() {
        let end = rest.iter().position(|byte| byte & 0x80 == 0);
        let (size, rest) = rest.split_at(end.ok_or(".stack_sizes ends in a number")? + 1);
        let size = size
            .iter()
            .rev()
            .fold(0, |size, byte| size << 7 | u32::from(byte & 0x7F));
        sizes.insert(u32::from_le_bytes(*address) & !1, size);
        table = rest;
    }
    Ok(sizes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn function(name: &str, frame: u32, calls: &[u32], jumps: &[u32]) -> Function {
        Function {
            name: name.to_owned(),
            frame,
            calls: calls.to_vec(),
            jumps: jumps.to_vec(),
            ..Function::default()
        }
    }

    fn depth(functions: Vec<(u32, Function)>) -> Result<Depth> {
        let graph = CallGraph {
            functions: functions.into_iter().collect(),
            global: BTreeMap::new(),
        };
        graph.depth(0, &mut Vec::new())
    }

    fn path(parts: &[(&str, u32)]) -> Vec<(String, u32)> {
        parts.iter().map(|(name, bytes)| ((*name).to_owned(), *bytes)).collect()
    }

    #[test]
    fn the_deepest_of_all_ways_down_counts() {
        let depth = depth(vec![
            (0, function("top", 10, &[1, 2], &[])),
            (1, function("wide", 50, &[], &[])),
            (2, function("thin", 5, &[3], &[])),
            (3, function("deep", 100, &[], &[])),
        ]);
        let depth = depth.unwrap();
        assert_eq!(depth.bytes, 115);
        assert_eq!(depth.path, path(&[("top", 10), ("thin", 5), ("deep", 100)]));
    }

    #[test]
    fn what_goes_on_in_a_function_s_place_has_its_stack_too() {
        let way = |frame| {
            depth(vec![
                (0, function("top", frame, &[], &[1])),
                (1, function("next", 50, &[], &[])),
            ])
        };
        assert_eq!(way(10).unwrap().bytes, 50);
        assert_eq!(way(60).unwrap().bytes, 60);
    }

    #[test]
    fn recursion_and_pointers_have_no_figure() {
        let error = depth(vec![
            (0, function("top", 10, &[1], &[])),
            (1, function("a", 50, &[2], &[])),
            (2, function("b", 50, &[1], &[])),
        ]);
        assert_eq!(error.unwrap_err().to_string(), "recursion: a calls b calls a");
        let mut calls_any = function("any", 0, &[], &[]);
        calls_any.pointers = true;
        let error = depth(vec![(0, function("top", 10, &[1], &[])), (1, calls_any)]);
        assert_eq!(error.unwrap_err().to_string(), "`any` calls what a pointer points at");
    }

    #[test]
    fn a_function_s_code_says_what_the_compiler_does_not() {
        // push {r4, lr}; sub sp, #8; bl +0x10; pop {r4, pc}
        let code = [0xB510_u16, 0xB082, 0xF000, 0xF806, 0xBD10];
        let code: Vec<u8> = code.into_iter().flat_map(u16::to_le_bytes).collect();
        let read = |said| {
            let mut function = function("f", 0, &[], &[]);
            function.end = 0x10A;
            function.read(0x100, &code, |_| true, said).map(|()| function)
        };
        let function = read(None).unwrap();
        assert_eq!((function.frame, &*function.calls), (16, &[0x114][..]));
        assert_eq!(read(Some(12)).unwrap().frame, 12);
        let error = read(Some(20)).unwrap_err();
        assert_eq!(error.to_string(), "`f` takes 20 bytes of stack, but its code 16");
    }

    #[test]
    fn the_compiler_s_table_is_addresses_and_uleb128() {
        let table = [0x01, 0x02, 0, 0, 0x10, 0x05, 0x02, 0, 0, 0x80, 0x02];
        let sizes = stack_sizes(&table).unwrap();
        assert_eq!(sizes, BTreeMap::from([(0x200, 16), (0x204, 256)]));
        assert!(stack_sizes(&table[..10]).is_err());
    }
}
