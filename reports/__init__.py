"""Tables, exports, figures and pages made from the results the planner hands over; nothing here simulates."""
