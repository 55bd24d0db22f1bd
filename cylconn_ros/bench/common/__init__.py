"""What all benchmarks share: settings, timing, results, reports, machine."""
