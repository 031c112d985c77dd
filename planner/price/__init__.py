"""What a plan costs, which plan is best, and the sentence that says so.

    machine    the hourly cost of tractor and implement as farm accounting has it
    cost       the cost of a plan in every draw: what is paid, and with ground that is late
    choice     the best of several plans by preference; what is too near to tell apart is equal
    advice     the choice in one sentence
"""
