"""What all benchmarks share: settings, timing, results, report, machine."""
