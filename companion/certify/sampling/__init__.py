"""What sampling does to the loop beyond the proof: the rate of adaptation, and held loops that are flown."""
