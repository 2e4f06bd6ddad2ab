//! Every example frame of the page, and the frames it should have printed.
