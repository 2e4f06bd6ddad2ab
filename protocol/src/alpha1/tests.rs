//! Every row of the document, and the frames it should have printed.
