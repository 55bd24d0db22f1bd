"""What becomes of the node when messages, processes and disks fail: in process and with real ones.

``sweep`` puts a faulty way between plant and connector on every scene of the library; ``processes``
asks the program that does it to real nodes (ros/faults); ``show`` makes tables of both.
"""
