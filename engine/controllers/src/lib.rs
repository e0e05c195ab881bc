//! Inference of every controller in one written-down binary32 arithmetic.
