# Defines the target armwire_cargo and sets ARMWIRE_LIBRARY to the path of its library. The target builds the library with
# these protocols for a target of the Rust compiler (empty for this machine).
find_program(CARGO cargo REQUIRED)

function(armwire_cargo rust_target protocols)
  set(target_dir ${CMAKE_CURRENT_BINARY_DIR}/cargo)
  set(target_option)
  if(rust_target)
    set(target_option --target ${rust_target})
  endif()
  set(library ${target_dir}/${rust_target}/c/libarmwire_c.a)
  # Always runs: cargo detects changes.
  add_custom_target(armwire_cargo ALL
    COMMAND ${CARGO} rustc --manifest-path ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../Cargo.toml --profile c
            --crate-type staticlib --target-dir ${target_dir} ${target_option}
            --no-default-features --features ${protocols}
    BYPRODUCTS ${library}
    USES_TERMINAL VERBATIM)
  set(ARMWIRE_LIBRARY ${library} PARENT_SCOPE)
endfunction()
