//! What fuzzing has found, each as a test of its own.
