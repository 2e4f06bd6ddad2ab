//! Each kind of arm on the UART of the firmware image.
